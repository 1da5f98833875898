// SPDX-License-Identifier: Apache-2.0
// All that happens before the first step.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <torch/types.h>

#include "jade/run/pace.h"
#include "jade/run/run_data.h"
#include "jade/run/run_directory.h"
#include "jade/run/stage_times.h"
#include "jade/train/options.h"
#include "jade/train/state.h"
#include "jade/train/step_feed.h"
#include "jade/train/step_graph.h"

namespace jade::run {

/// The parts that a run begins with.
struct Prepared {
  StageTimes times;           ///< since the start of prepare()
  train::RunOptions options;  ///< settled, and with the schedule of a resumed run
  torch::Device device;
  RunDirectory directory;
  RunData data;
  std::unique_ptr<train::StreamScope> stream;  ///< of the calling thread, for all that follows
  train::TrainState state;
  train::StepFeed feed;
};

/// Loads the data, creates or loads the state, restores the exposures and writes config.yaml and
/// env.json. Parameters and errors are those of Trainer().
Prepared prepare(const train::RunOptions& options, const std::filesystem::path& run,
                 const std::string& from, const std::optional<Choices>& choices);

/// config.yaml of a run.
std::string resolved_yaml(train::RunOptions options);

}  // namespace jade::run
