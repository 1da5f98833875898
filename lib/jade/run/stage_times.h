// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace jade::run {

/// Where the time of a run goes: the clock runs on, and what has passed belongs to a stage.
class StageTimes {
 public:
  StageTimes();
  /// What has passed since the last call, or since the beginning, belongs to `stage`.
  void end(const std::string& stage);
  /// In seconds, in the order in which the stages first ended.
  const std::vector<std::pair<std::string, double>>& seconds() const { return seconds_; }
  /// "data 1.2 s, steps 20.0 s; 21.2 s in all"; what took less than 0.05 s is left out.
  std::string text() const;

 private:
  double since_;
  std::vector<std::pair<std::string, double>> seconds_;
};

}  // namespace jade::run
