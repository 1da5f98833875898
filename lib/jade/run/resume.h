// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "jade/run/pace.h"
#include "jade/run/run_data.h"
#include "jade/run/run_directory.h"
#include "jade/train/options.h"
#include "jade/train/state.h"

namespace jade::run {

/// The options in a checkpoint's YAML, settled; keys that it lacks have their printed values
/// (train::printed_options).
/// @throws CheckpointError for the YAML of another version.
train::RunOptions saved_options(const std::string& yaml);

/// Continues a run from a checkpoint of the same settings, data and restorer. Settings that affect
/// when a run stops or what it shows may differ.
/// @param choice   "latest": the newest undamaged checkpoint of the folder; else the path of one
/// @param choices  settings that the run may have chosen (choose_pace())
/// @param options  receives the decisions of the run's start: its schedule, choices, thresholds,
///   number of Gaussians, pattern, gains and near plane
/// @return its state; without value if the folder has neither a checkpoint nor results
/// @throws ConfigError, CheckpointError.
std::optional<train::TrainState> resume(const RunDirectory& directory, const std::string& choice,
                                        const RunData& data, const std::optional<Choices>& choices,
                                        torch::Device device, train::RunOptions& options);

}  // namespace jade::run
