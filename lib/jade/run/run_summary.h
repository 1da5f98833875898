// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "jade/gaussians/summary.h"
#include "jade/train/options.h"

namespace jade::run {

/// How far a run has come, and what is wrong with its folder.
struct RunSummary {
  train::RunOptions options;
  int64_t step = 0;        ///< of the newest whole checkpoint
  nlohmann::json metrics;  ///< the last line of metrics.jsonl, or null
  nlohmann::json scores;   ///< the means of eval.json, or null
  gaussians::GaussianSummary gaussians;
  std::vector<std::string> problems;  ///< one line each, with the fix
};

/// True for a folder that jade_train made: it has config.yaml and checkpoints/, metrics.jsonl or
/// train.log.
bool is_run(const std::filesystem::path& folder);

/// @throws ConfigError if its config.yaml cannot be read, DataError if its .ply cannot. Whatever
///   else is damaged or missing is one of the problems.
RunSummary summarize_run(const std::filesystem::path& run);

}  // namespace jade::run
