// SPDX-License-Identifier: Apache-2.0
// jade_bench splat: the splatting op, all views of a workload in one call.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/cli.h"
#include "timing.h"

namespace jade::bench {

struct SplatBench {
  std::vector<std::filesystem::path> inputs;
  std::vector<std::string> names;
  std::filesystem::path dump, write;
  bool million = false;
  bool deterministic = false;
  bool through_loss = false;
  bool one_by_one = false;
  Repeats repeats;

  /// Adds the subcommand and its flags.
  CLI::App* add_to(CLI::App& cli);
  ExitCode run(const apps::Program& program) const;
};

}  // namespace jade::bench
