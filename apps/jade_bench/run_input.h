// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/run/trainer.h"

namespace jade::bench {

/// Checks the conditions of write_run_input() that depend on the settings alone.
/// @throws ConfigError for a target that a router computes, and for moments sampled per step.
void check_run_input(const train::RunOptions& options);

/// Writes all inputs of a run, so that another program can train the same losses on them: .npy
/// files and training.json (scripts/gsplat_training.py reads them).
/// @param trainer  before its first step, with a target that does not depend on a router
/// @throws ConfigError for another target, or for moments sampled per step.
void write_run_input(const run::Trainer& trainer, const std::filesystem::path& folder);

}  // namespace jade::bench
