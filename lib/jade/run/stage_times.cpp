// SPDX-License-Identifier: Apache-2.0
#include "jade/run/stage_times.h"

#include <algorithm>
#include <chrono>
#include <cstdio>

namespace jade::run {
namespace {

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string in_seconds(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", seconds);
  return text;
}

}  // namespace

StageTimes::StageTimes() : since_(now()) {}

void StageTimes::end(const std::string& stage) {
  const double time = now(), passed = time - since_;
  since_ = time;
  const auto known = std::find_if(seconds_.begin(), seconds_.end(),
                                  [&](const auto& entry) { return entry.first == stage; });
  if (known != seconds_.end()) {
    known->second += passed;
  } else {
    seconds_.emplace_back(stage, passed);
  }
}

double StageTimes::without(const std::string& stage) const {
  double sum = now() - since_;
  for (const auto& [name, seconds] : seconds_) sum += name == stage ? 0 : seconds;
  return sum;
}

std::string StageTimes::text() const {
  std::string text;
  double all = 0;
  for (const auto& [stage, seconds] : seconds_) {
    all += seconds;
    if (seconds < 0.05) continue;
    text += (text.empty() ? "" : ", ") + stage + " " + in_seconds(seconds);
  }
  return text + (text.empty() ? "" : "; ") + in_seconds(all) + " in all";
}

}  // namespace jade::run
