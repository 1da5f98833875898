// SPDX-License-Identifier: Apache-2.0
// jade_bench losses: every term of the objectives, and the router, measured separately.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "common/cli.h"
#include "timing.h"

namespace jade::bench {

struct LossesBench {
  std::vector<std::string> names;
  Repeats repeats;

  /// Adds the subcommand and its flags.
  CLI::App* add_to(CLI::App& cli);
  ExitCode run(const apps::Program& program) const;
};

}  // namespace jade::bench
