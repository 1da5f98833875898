// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "jade/data/exposure.h"
#include "jade/eval/report.h"
#include "jade/train/bank.h"
#include "jade/train/options.h"
#include "jade/train/state.h"

namespace jade::run {

/// A read-only view of a run for observers.
struct WatchedRun {
  const data::Dataset& dataset;
  const train::ViewBank& bank;
  train::TrainState& state;
  const train::RunOptions& options;
  std::filesystem::path folder;
};

/// Observer of a run. All calls come from the training thread.
class Watcher {
 public:
  virtual ~Watcher() = default;

  /// Called before the first step. `run` stays valid during the Trainer's lifetime.
  virtual void begin(const WatchedRun& run) = 0;
  /// Called after each step; the run waits for it to return.
  /// @return seconds of waiting that do not count as training, such as a pause
  virtual double after_step() = 0;
  /// Called with scores of the test views, between two steps.
  /// @param posed  the data set with the poses of the evaluation
  virtual void on_evaluation(const data::Dataset& posed, const eval::Evaluation& evaluation) = 0;
  /// Called with each line of metrics.jsonl.
  virtual void on_metrics(const std::string& line) = 0;
  /// Called when no step follows.
  virtual void ended() = 0;
};

}  // namespace jade::run
