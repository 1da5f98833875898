// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/sampling.h"

#include <algorithm>
#include <cmath>

namespace jade::simulate {
namespace {

constexpr int64_t kMargin_us = 5000;      // recorded before the first and after the last exposure
constexpr double kLongestStep_us = 4000;  // maximum sampling step of the light

}  // namespace

Timeline make_timeline(const SimulateOptions& o) {
  Timeline timeline;
  const auto exposure = static_cast<int64_t>(std::llround(o.exposure_ms * 1000));
  const auto gap = static_cast<int64_t>(std::llround(o.gap_ms * 1000));
  for (int64_t i = 0; i < o.exposures; ++i) {
    const int64_t begin = kMargin_us + i * (exposure + gap);
    timeline.exposures.push_back({begin, begin + exposure});
  }
  timeline.end_us = timeline.exposures.back().end_us + kMargin_us;
  // Seen views at the middles of evenly chosen exposures, the others in evenly chosen gaps.
  for (int64_t i = 0; i < o.seen_test_views; ++i) {
    const int64_t k = (2 * i + 1) * o.exposures / (2 * o.seen_test_views);
    timeline.tests_us.push_back(timeline.exposures[static_cast<size_t>(k)].mid_us());
  }
  const int64_t unseen = o.test_views - o.seen_test_views;
  const int64_t gaps = std::max<int64_t>(o.exposures - 1, 1);
  const auto gap_of = [&](int64_t i) { return (2 * i + 1) * gaps / (2 * unseen); };
  for (int64_t i = 0; i < unseen; ++i) {
    // Views in the same gap divide it evenly.
    int64_t before = 0, sharing = 1;
    while (i - before > 0 && gap_of(i - before - 1) == gap_of(i)) ++before;
    while (i - before + sharing < unseen && gap_of(i - before + sharing) == gap_of(i)) ++sharing;
    const int64_t end_us = timeline.exposures[static_cast<size_t>(gap_of(i))].end_us;
    timeline.tests_us.push_back(end_us + gap * (before + 1) / (sharing + 1));
  }
  return timeline;
}

double set_speed_for_blur(CameraPath& path, const world::FrameSource& source,
                          const geometry::Intrinsics& camera, const Timeline& timeline,
                          double blur_px) {
  const geometry::Intrinsics coarse = geometry::scaled(camera, 32, 24);
  const size_t stride = (timeline.exposures.size() + 7) / 8;
  const auto mean_blur = [&] {
    double sum = 0;
    int count = 0;
    world::SharpFrame mid;
    for (size_t i = 0; i < timeline.exposures.size(); i += stride, ++count) {
      const auto& window = timeline.exposures[i];
      source.render(path.at(static_cast<double>(window.mid_us())), coarse, 1, mid);
      sum += blur_length(path, camera, mid, static_cast<double>(window.begin_us),
                         static_cast<double>(window.end_us));
    }
    return sum / count;
  };
  double low = 1e-3, high = 100, blur = 0;
  for (int i = 0; i < 24; ++i) {
    path.set_speed(std::sqrt(low * high));
    blur = mean_blur();
    if (std::abs(blur - blur_px) < 0.02 * blur_px) break;
    (blur < blur_px ? low : high) = path.speed();
  }
  return blur;
}

FrameClock::FrameClock(const SamplingOptions& options, const CameraPath& path,
                       const geometry::Intrinsics& camera)
    : options_(options), path_(path), camera_(camera) {}

int64_t FrameClock::next_us(const world::SharpFrame& frame, int64_t now_us, int64_t until_us) {
  const auto now = static_cast<double>(now_us);
  const geometry::Pose from = path_.at(now);
  const double frame_us = options_.min_fps > 0 ? 1e6 / options_.min_fps : kLongestStep_us;
  const double longest =
      std::max(1.0, std::min({static_cast<double>(until_us - now_us), frame_us, kLongestStep_us}));
  double step = std::min(step_us_, longest);
  for (int trial = 0; trial < 12; ++trial) {
    const double flow =
        largest_flow(frame, camera_, from, path_.at(now + step)) / options_.max_flow_px;
    if (flow <= 1 && (flow > 0.8 || step >= longest)) break;
    step = std::min(longest, step * std::clamp(0.92 / std::max(flow, 1e-9), 0.2, 2.0));
  }
  while (step > 1 &&
         largest_flow(frame, camera_, from, path_.at(now + step)) > options_.max_flow_px) {
    step *= 0.8;
  }
  if (step < longest) step_us_ = step;
  return std::min(until_us, now_us + std::max<int64_t>(1, static_cast<int64_t>(step)));
}

}  // namespace jade::simulate
