// SPDX-License-Identifier: Apache-2.0
// jade_bench restorer: seconds per frame of a learned restorer, and of nine moments of a frame.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "common/cli.h"
#include "jade/restore/efnet.h"
#include "timing.h"

namespace jade::bench {

struct RestorerBench {
  restore::EfnetOptions efnet;
  std::vector<std::filesystem::path> inputs;
  std::filesystem::path dump;
  std::vector<double> times;
  std::vector<std::string> sizes{"346x260", "600x400"};
  Repeats repeats{2, 10};

  /// Adds the subcommand and its flags.
  CLI::App* add_to(CLI::App& cli);
  ExitCode run(const apps::Program& program) const;
};

}  // namespace jade::bench
