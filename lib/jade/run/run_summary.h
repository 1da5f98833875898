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

/// Progress of a run, and the problems of its folder.
struct RunSummary {
  train::RunOptions options;
  int64_t step = 0;        ///< of the newest undamaged checkpoint
  nlohmann::json metrics;  ///< the last line of metrics.jsonl, or null
  nlohmann::json scores;   ///< the means of eval.json, or null
  gaussians::GaussianSummary gaussians;
  std::vector<std::string> problems;  ///< one line each, with the fix
};

/// True for a folder that jade_train created: it has config.yaml and checkpoints/, metrics.jsonl or
/// train.log.
bool is_run(const std::filesystem::path& folder);

/// @throws ConfigError if its config.yaml cannot be read, DataError if its .ply cannot. Other
///   damaged or missing files are listed as problems.
RunSummary summarize_run(const std::filesystem::path& run);

}  // namespace jade::run
