// SPDX-License-Identifier: Apache-2.0
// jade_bench events: the event sums of one exposure, on the CPU.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>

#include "common/cli.h"
#include "timing.h"

namespace jade::bench {

struct EventsBench {
  int64_t width = 1280, height = 720, count = 5600000;
  Repeats repeats{2, 10};

  /// Adds the subcommand and its flags.
  CLI::App* add_to(CLI::App& cli);
  ExitCode run(const apps::Program& program) const;
};

}  // namespace jade::bench
