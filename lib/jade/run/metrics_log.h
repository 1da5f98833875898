// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "jade/eval/report.h"
#include "jade/train/options.h"
#include "jade/train/state.h"
#include "jade/train/step_graph.h"
#include "jade/train/step_inputs.h"

namespace jade::run {

/// metrics.jsonl: one JSON object per line.
class MetricsLog {
 public:
  /// Continues the file, after dropping lines of steps after `step`, which a killed run wrote.
  MetricsLog(std::filesystem::path path, int64_t step);
  void append(const nlohmann::ordered_json& line);
  /// "seconds" of the last remaining line; 0 without one.
  double seconds_before() const { return seconds_before_; }
  /// Also calls `listener` with each line from now on.
  void tell(std::function<void(const std::string&)> listener) { listener_ = std::move(listener); }

 private:
  std::filesystem::path path_;
  double seconds_before_ = 0;
  std::function<void(const std::string&)> listener_;
};

/// Values of a step: each term and their sum ("loss"), PSNR of the frame against the mean of its
/// renders ("psnr_train"), statistics of α and of gains, and the number of Gaussians.
nlohmann::ordered_json step_line(const train::StepInputs& inputs, const train::StepOutputs& out,
                                 train::TrainState& state, const train::RunOptions& options);

/// Mean scores, over all views and over those that training has seen or not. Logs them too.
nlohmann::ordered_json evaluation_line(int64_t step, double seconds,
                                       const eval::Evaluation& evaluation);

}  // namespace jade::run
