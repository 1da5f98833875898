// SPDX-License-Identifier: Apache-2.0
// jade_bench iteration: a whole training step of any configuration, with all of its active terms.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "common/cli.h"
#include "timing.h"

namespace jade::bench {

struct IterationBench {
  std::vector<std::string> names{"W2"};
  std::filesystem::path trace;
  bool eager = false;
  Repeats repeats{20, 300};

  /// Adds the subcommand and its flags.
  CLI::App* add_to(apps::Program& program);
  ExitCode run(const apps::Program& program) const;
};

}  // namespace jade::bench
