// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace jade::run {

/// Wall-clock time of each stage of a run.
class StageTimes {
 public:
  StageTimes();
  /// Adds the time since the last call, or since construction, to `stage`.
  void end(const std::string& stage);
  /// In seconds, in the order in which the stages first ended.
  const std::vector<std::pair<std::string, double>>& seconds() const { return seconds_; }
  /// Seconds since construction, without those of `stage`.
  double without(const std::string& stage) const;
  /// "data 1.2 s, steps 20.0 s; 21.2 s in all"; omits stages of less than 0.05 s.
  std::string text() const;

 private:
  double since_;
  std::vector<std::pair<std::string, double>> seconds_;
};

}  // namespace jade::run
