// SPDX-License-Identifier: Apache-2.0
#include "jade/train/event_windows.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <unordered_set>

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/events/counts.h"
#include "jade/train/view.h"

namespace jade::train {
namespace {

/// Samples `count` distinct numbers below `bound`, unsorted; all of them if there are no more.
torch::Tensor draw_distinct(at::Generator& generator, int64_t count, int64_t bound) {
  if (count >= bound) return torch::arange(bound, torch::kInt64);
  std::unordered_set<int64_t> sampled;
  const torch::Tensor pixels = torch::empty({count}, torch::kInt64);
  int64_t* const out = pixels.mutable_data_ptr<int64_t>();
  for (int64_t i = 0; i < count;) {
    const int64_t pixel = draw_index(generator, bound);
    if (sampled.insert(pixel).second) out[i++] = pixel;
  }
  return pixels;
}

}  // namespace

EventWindows::EventWindows(const data::Dataset& dataset, const losses::ObjectiveOptions& options,
                           uint64_t seed, torch::Device device)
    : events_(dataset.events),
      on_device_(dataset.events.to(device)),
      size_{dataset.train.front().camera.height, dataset.train.front().camera.width},
      cameras_(camera_batch({{}, {}}, dataset.train.front().camera, device)),
      pixels_(options.event_pixels),
      seed_(seed),
      device_(device) {
  const double exposure_us = static_cast<double>(dataset.train.front().duration_us());
  window_us_ = std::max<int64_t>(1, std::llround(exposure_us * options.event_window_share));
  for (const data::Exposure& exposure : dataset.train) spans_.push_back(span_of(exposure));
  if (dataset.event_color.defined()) {
    color_filter_ = dataset.event_color.permute({1, 2, 0}).contiguous().to(device);
  }
}

EventWindow EventWindows::at(int64_t step, int64_t view) const {
  const ExposureSpan& span = spans_.at(static_cast<size_t>(view));
  auto generator = make_generator(seed_, concat("event window of step ", step));
  const int64_t last_start = std::max(span.begin_us, span.end_us - window_us_);
  const int64_t begin = span.begin_us + draw_index(generator, last_start - span.begin_us + 1);
  // A window that is longer than its exposure is cut at its end, like the path.
  const int64_t end = std::min(begin + window_us_, std::max(span.end_us, begin + 1));
  const torch::Tensor pixels = draw_distinct(generator, pixels_, size_.height * size_.width);
  // All random choices of the host in one copy: two poses, two times, the pixels, all exact in
  // float64.
  const torch::Tensor sampled =
      torch::empty({2 * 16 + 2 + pixels.numel()},
                   torch::dtype(torch::kFloat64).pinned_memory(device_.is_cuda()));
  sampled.narrow(0, 0, 32).copy_(geometry::to_tensor({span.path.at(static_cast<double>(begin)),
                                                      span.path.at(static_cast<double>(end))})
                                     .flatten());
  const auto length = static_cast<double>(std::max<int64_t>(1, span.end_us - span.begin_us));
  const auto unit = [&](int64_t t_us) {
    return std::clamp(static_cast<double>(t_us - span.begin_us) / length, 0.0, 1.0);
  };
  sampled[32] = unit(begin);
  sampled[33] = unit(end);
  sampled.narrow(0, 34, pixels.numel()).copy_(pixels);
  const torch::Tensor there = sampled.to(device_, /*non_blocking=*/true);

  EventWindow window;
  window.cameras = cameras_;
  window.cameras.camera_from_world = there.narrow(0, 0, 32).view({2, 4, 4}).to(torch::kFloat32);
  window.u = there.narrow(0, 32, 2);
  window.pixels = there.narrow(0, 34, pixels.numel()).to(torch::kInt64);
  window.counts = events::signed_count(
      on_device_.range(events_.count_before(begin), events_.count_before(end)), size_);
  window.color_filter = color_filter_;
  return window;
}

}  // namespace jade::train
