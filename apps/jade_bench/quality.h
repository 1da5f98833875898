// SPDX-License-Identifier: Apache-2.0
// jade_bench quality: when finished runs first reached a score, with seeds side by side.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <vector>

#include "common/cli.h"

namespace jade::bench {

struct QualityBench {
  std::vector<std::filesystem::path> runs;  ///< run directories, or folders that contain some
  std::vector<double> goals;                ///< dB
  std::filesystem::path csv;                ///< output file with one line per run; empty: none

  /// Adds the subcommand and its flags.
  CLI::App* add_to(apps::Program& program);
  ExitCode run(const apps::Program& program) const;
};

}  // namespace jade::bench
