// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/eval/report.h"
#include "jade/restore/efnet.h"
#include "jade/run/checkpoint.h"
#include "jade/run/learned_cameras.h"
#include "jade/run/pace.h"
#include "jade/run/picture_writer.h"
#include "jade/run/run_directory.h"
#include "jade/run/stage_times.h"
#include "jade/run/term_monitor.h"
#include "jade/run/watcher.h"
#include "jade/train/options.h"
#include "jade/train/state.h"
#include "jade/train/step_feed.h"
#include "jade/train/step_graph.h"

namespace jade::run {

/// Training data of a run.
struct RunData {
  data::Dataset dataset;
  std::string fingerprint;                  ///< of the data set, see data_fingerprint()
  std::string restorer_sha256;              ///< empty where no restorer is needed
  std::future<restore::Restorer> restorer;  ///< on its way, where it runs on a GPU
};

/// The loop and its calendar: what is due at which step. What a step does stands in routing_step.h
/// and scene_step.h.
class Trainer {
 public:
  /// Loads the data, prepares the views and makes or loads the state.
  /// @param resume  empty: a new run, refused where one is already; "latest": the newest whole
  ///   checkpoint of the run directory, or the start where there is none; else the path of a
  ///   checkpoint.
  /// @param choices  what a new run may choose by itself (choose_pace()), and a resumed one takes
  ///   from the run; without value: nothing
  /// @throws the typed errors of core/error.h.
  Trainer(const train::RunOptions& options, const std::filesystem::path& run,
          const std::string& resume, const std::optional<Choices>& choices = std::nullopt);
  ~Trainer();

  /// Trains to options.train.iterations, then evaluates and exports.
  /// @param watcher  may look on; the result is the same to the bit
  /// @throws Interrupted after saving, NumericError with the last good checkpoint kept.
  void run(Watcher* watcher = nullptr);

  /// One step: nine renders, routing step, scene step, densification.
  /// @param look  called before densification: after a reset of the opacities a scene shows nothing
  ///   for some steps
  void step(const std::function<void()>& look = {});

  /// Effective options: settled, and with the calendar of a resumed run.
  const train::RunOptions& options() const { return options_; }
  const train::TrainState& state() const { return state_; }
  const data::Dataset& dataset() const { return data_.dataset; }
  const train::ViewBank& bank() const { return feed_.bank(); }
  /// How many of the steps were replays of a CUDA graph.
  int64_t replays() const { return step_graph_.replays(); }
  /// Scores on the sharp test views as they are now, LPIPS where its modules are at hand.
  eval::Evaluation evaluate();
  /// Whether the data set has sharp test views or held-out exposures.
  bool can_evaluate() const;

 private:
  eval::Evaluation evaluate(const data::Dataset& posed);
  bool learns_gains() const;
  /// False where there is nothing to go on from.
  bool resume_from(const std::string& choice);
  /// Puts on or off in place of pattern.learn auto.
  void settle_pattern();
  /// Keeps the decisions of the run's start: its calendar, thresholds, pattern and near plane.
  void keep_decisions(const train::RunOptions& saved);
  void check_same_run(const std::filesystem::path& checkpoint, const CheckpointInfo& info) const;
  void announce() const;
  void write_environment() const;
  void log_step(const train::StepInputs& inputs, const train::StepOutputs& out);
  /// @param seconds  run_seconds() before the look began
  eval::Evaluation log_evaluation(const data::Dataset& posed, double seconds);
  /// "seconds" of a line of metrics.jsonl: that the run has taken, without its looks on the way.
  double run_seconds() const;
  /// Evaluation and pictures that are due.
  void look(Watcher* watcher);
  void save();
  /// The data set with the poses at which the scene is to be seen: learned ones where poses are.
  data::Dataset posed_dataset();
  /// posed_dataset() for a look on the way: the fit of test poses goes on from the last look's.
  const data::Dataset& look_at_dataset();
  /// @param truths  the test views' sharp images too
  void write_pictures(const data::Dataset& posed, bool truths = false);
  [[noreturn]] void stop();
  void finish();

  StageTimes times_;  // begins before anything else does
  train::RunOptions options_;
  std::optional<Choices> choices_;
  torch::Device device_;
  RunDirectory directory_;
  RunData data_;
  train::StreamScope stream_;  // before every tensor on a GPU, which starts while data are read
  train::TrainState state_;
  train::StepFeed feed_;
  train::StepGraph step_graph_;
  TermMonitor monitor_;
  std::unique_ptr<MetricsLog> metrics_;
  PictureWriter pictures_;
  std::optional<data::Dataset> looked_at_;  // of the last look on the way, where poses are learned
  std::string status_;                      // for the progress bar
  double logged_seconds_ = 0;               // clock and step of the last log line, for it/s
  int64_t logged_step_ = 0;
};

}  // namespace jade::run
