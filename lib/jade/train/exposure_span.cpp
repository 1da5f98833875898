// SPDX-License-Identifier: Apache-2.0
#include "jade/train/exposure_span.h"

#include <utility>

namespace jade::train {
namespace {

/// Timed poses in strictly increasing order; of two at one time the first is kept.
class TimedPoses {
 public:
  void add(double t_us, const geometry::Pose& pose) {
    if (!times_.empty() && t_us <= times_.back()) return;
    times_.push_back(t_us);
    poses_.push_back(pose);
  }
  void add(const data::Exposure& exposure) {
    const auto times = geometry::exposure_times(exposure.t_start_us, exposure.t_end_us);
    for (size_t k = 0; k < times.size(); ++k) add(times[k], exposure.poses[k]);
  }
  geometry::Trajectory path() const { return {times_, poses_}; }

 private:
  std::vector<double> times_;
  std::vector<geometry::Pose> poses_;
};

}  // namespace

ExposureSpan span_of(const data::Exposure& exposure) {
  TimedPoses poses;
  poses.add(exposure);
  return {exposure.t_start_us, exposure.t_end_us, poses.path()};
}

std::vector<ExposureSpan> exposure_spans(const data::Dataset& dataset) {
  std::vector<ExposureSpan> spans;
  const geometry::Trajectory& whole = dataset.trajectory;
  for (const data::Exposure& exposure : dataset.train) {
    ExposureSpan span = span_of(exposure);
    const bool covered = !whole.empty() && whole.begin_us() <= static_cast<double>(span.begin_us) &&
                         whole.end_us() >= static_cast<double>(span.end_us);
    if (covered) span.path = whole;
    spans.push_back(std::move(span));
  }
  return spans;
}

}  // namespace jade::train
