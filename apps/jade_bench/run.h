// SPDX-License-Identifier: Apache-2.0
// jade_bench run: time to quality, the seconds until a scene first reaches a score.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "common/cli.h"

namespace jade::bench {

struct RunBench {
  std::vector<double> goals;  ///< dB
  int64_t every = 250;
  std::filesystem::path input;  ///< output folder for the run's inputs; empty: none

  /// Adds the subcommand and its flags.
  CLI::App* add_to(apps::Program& program);
  ExitCode run(const apps::Program& program) const;
};

}  // namespace jade::bench
