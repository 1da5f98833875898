// SPDX-License-Identifier: Apache-2.0
// jade_bench quality: when runs that have ended first scored so many decibels, seeds side by side.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <vector>

#include "common/cli.h"

namespace jade::bench {

struct QualityBench {
  std::vector<std::filesystem::path> runs;  ///< run directories, or folders that hold some
  std::vector<double> goals;                ///< dB
  std::filesystem::path csv;                ///< where every run's line is written; empty: nowhere

  /// Adds the subcommand and its flags.
  CLI::App* add_to(apps::Program& program);
  ExitCode run(const apps::Program& program) const;
};

}  // namespace jade::bench
