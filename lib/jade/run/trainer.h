// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/eval/report.h"
#include "jade/run/learned_cameras.h"
#include "jade/run/metrics_log.h"
#include "jade/run/picture_writer.h"
#include "jade/run/prepare.h"
#include "jade/run/term_monitor.h"
#include "jade/run/watcher.h"
#include "jade/train/options.h"
#include "jade/train/state.h"
#include "jade/train/step_feed.h"
#include "jade/train/step_graph.h"

namespace jade::run {

/// The training loop and its schedule. routing_step.h and scene_step.h define a step.
class Trainer {
 public:
  /// Loads the data, prepares the views and creates or loads the state.
  /// @param from  empty: a new run, an error if the folder has one; "latest": the newest
  ///   undamaged checkpoint of the run directory, or a new run without one; else the path of a
  ///   checkpoint.
  /// @param choices  settings that a new run may choose (choose_pace()), and a resumed one takes
  ///   from the run; without value: none
  /// @throws the typed errors of core/error.h.
  Trainer(const train::RunOptions& options, const std::filesystem::path& run,
          const std::string& from, const std::optional<Choices>& choices = std::nullopt);
  ~Trainer();

  /// Trains to options.train.iterations, then evaluates and exports.
  /// @param watcher  observes the run; the result is bit-identical without it
  /// @throws Interrupted after saving, NumericError; the last good checkpoint stays.
  void run(Watcher* watcher = nullptr);

  /// One step: renders, routing step, scene step.
  void step();
  /// Densification, at its steps. Evaluate before it: after an opacity reset renders are empty for
  /// some steps.
  void densify();

  /// Effective options: settled, and with the schedule of a resumed run.
  const train::RunOptions& options() const { return options_; }
  const train::TrainState& state() const { return state_; }
  const data::Dataset& dataset() const { return data_.dataset; }
  const train::ViewBank& bank() const { return feed_.bank(); }
  /// Number of steps that replayed a CUDA graph.
  int64_t replays() const { return step_graph_.replays(); }
  /// Scores of the current scene on the sharp test views, with LPIPS if its modules are available.
  eval::Evaluation evaluate();
  /// Whether the data set has sharp test views or held-out exposures.
  bool can_evaluate() const;

 private:
  eval::Evaluation evaluate(const data::Dataset& posed);
  bool learns_gains() const;
  bool is_over() const;
  void log_step(const train::StepInputs& inputs, const train::StepOutputs& out);
  /// "seconds" of a line of metrics.jsonl: duration of the run without intermediate evaluations.
  double run_seconds() const;
  /// Runs the evaluation and writes the pictures that are due.
  void look(Watcher* watcher);
  /// Begins to write a checkpoint beside the next steps.
  void save();
  /// Waits for the checkpoint that is being written. @throws DataError if it could not be written.
  void finish_save();
  /// The data set with the poses to evaluate at: learned ones if poses are learned.
  /// @param last  of the last intermediate evaluation, whose fit of test poses it continues
  data::Dataset posed_dataset(const data::Dataset* last = nullptr,
                              OnInterrupt on_interrupt = OnInterrupt::kEnd);
  /// posed_dataset() for an intermediate evaluation.
  const data::Dataset& look_at_dataset();
  /// @param truths  write the test views' sharp images too
  void write_pictures(const data::Dataset& posed, bool truths = false);
  [[noreturn]] void stop();
  void finish();

  explicit Trainer(Prepared parts);

  StageTimes times_;
  train::RunOptions options_;
  torch::Device device_;
  RunDirectory directory_;
  RunData data_;
  std::unique_ptr<train::StreamScope> stream_;
  train::TrainState state_;
  train::StepFeed feed_;
  train::StepGraph step_graph_;
  TermMonitor monitor_;
  std::unique_ptr<MetricsLog> metrics_;
  PictureWriter pictures_;
  std::future<void> saving_;
  // of the last intermediate evaluation, if poses are learned
  std::optional<data::Dataset> looked_at_;
  std::string status_;         // for the progress bar
  double logged_seconds_ = 0;  // time and step of the last log line, for it/s
  int64_t logged_step_ = 0;
};

}  // namespace jade::run
