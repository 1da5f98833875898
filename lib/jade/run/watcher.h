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

/// A run as somebody sees it who looks on. Not to be changed: training goes on from it.
struct WatchedRun {
  const data::Dataset& dataset;
  const train::ViewBank& bank;
  train::TrainState& state;
  const train::RunOptions& options;
  std::filesystem::path folder;
};

/// Somebody who looks on while a run trains. All calls come from the thread that trains.
class Watcher {
 public:
  virtual ~Watcher() = default;

  /// Before the first step. `run` stays valid while the Trainer lives.
  virtual void begin(const WatchedRun& run) = 0;
  /// After each step; the run waits for it to return.
  /// @return seconds of waiting that are not the step's, as while paused
  virtual double after_step() = 0;
  /// Scores of the test views between two steps.
  /// @param posed  the data set with the poses that it was scored at
  virtual void on_evaluation(const data::Dataset& posed, const eval::Evaluation& evaluation) = 0;
  /// A line of metrics.jsonl.
  virtual void on_metrics(const std::string& line) = 0;
  /// No step follows.
  virtual void ended() = 0;
};

}  // namespace jade::run
