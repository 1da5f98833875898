// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/run/trainer.h"

namespace jade::bench {

/// Checks the conditions of write_run_input() that depend on the settings alone.
/// @throws ConfigError for a target that a router decides, and for moments that the steps draw.
void check_run_input(const train::RunOptions& options);

/// All that a run starts from, so that any other program can train the same losses on it: .npy
/// files and training.json (scripts/gsplat_training.py reads them).
/// @param trainer  before its first step, with a target that no router decides
/// @throws ConfigError for another target, or for moments that the steps draw.
void write_run_input(const run::Trainer& trainer, const std::filesystem::path& folder);

}  // namespace jade::bench
