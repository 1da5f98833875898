// SPDX-License-Identifier: Apache-2.0
#include "jade/events/ramps.h"

#include <algorithm>
#include <torch/types.h>
#include <vector>

#include "jade/core/check.h"
#include "jade/events/count_math.h"
#include "jade/events/counts.h"

namespace jade::events {
namespace {

/// Calls add(window, share) for the windows between `knots` that the span (begin, end] of one
/// event's step reaches; shares add up to 1 over all time. An empty span is a step at `end`.
template <class Add>
void share_out(const std::vector<int64_t>& knots, int64_t begin, int64_t end, const Add& add) {
  const auto last = static_cast<int64_t>(knots.size()) - 2;
  const auto window_of = [&](int64_t t) {
    return std::upper_bound(knots.begin(), knots.end(), t) - knots.begin() - 1;
  };
  if (begin >= end) {
    const int64_t j = window_of(end);
    if (j >= 0 && j <= last) add(j, 1.0f);
    return;
  }
  for (int64_t j = std::max<int64_t>(0, window_of(begin)); j <= last && knots[j] < end; ++j) {
    const int64_t inside = std::min(end, knots[j + 1]) - std::max(begin, knots[j]);
    if (inside > 0) add(j, static_cast<float>(inside) / static_cast<float>(end - begin));
  }
}

}  // namespace

WindowCounts ramped_windows(const EventStream& events, const TimeWindow& exposure, int64_t parts,
                            int64_t reach_us, const ImageSize& size) {
  JADE_CHECK(parts > 0 && reach_us >= 0,
             "expected one window or more and a reach of 0 or more, found ", parts, " and ",
             reach_us, " us");
  std::vector<int64_t> knots;
  for (int64_t k = 0; k <= parts; ++k) knots.push_back(knot_us(exposure, k, parts));
  const int64_t windows = parts;
  const EventStream near = events.slice(knots.front() - reach_us, knots.back() + reach_us);
  const int64_t pixels = size.height * size.width;
  // Windows of one pixel side by side, as an event touches many of them.
  const torch::Tensor sums = torch::zeros({2, pixels, windows}, torch::kFloat32);
  auto* const out = sums.mutable_data_ptr<float>();
  std::vector<int64_t> before(static_cast<size_t>(pixels), knots.front() - 2 * reach_us);
  const float* const x = near.x().const_data_ptr<float>();
  const float* const y = near.y().const_data_ptr<float>();
  const int64_t* const t = near.t_us().const_data_ptr<int64_t>();
  const int8_t* const polarity = near.polarity().const_data_ptr<int8_t>();
  const auto width = static_cast<int32_t>(size.width), height = static_cast<int32_t>(size.height);
  for (int64_t i = 0; i < near.size(); ++i) {
    EventFootprint footprint;
    if (!locate(x[i], y[i], width, height, footprint)) continue;
    const int32_t column =
        std::clamp(footprint.column + int32_t(footprint.fx >= kWhole / 2), 0, width - 1);
    const int32_t row =
        std::clamp(footprint.row + int32_t(footprint.fy >= kWhole / 2), 0, height - 1);
    int64_t& previous = before[static_cast<size_t>(row) * size.width + column];
    const int64_t begin = std::max(previous, t[i] - reach_us);
    previous = t[i];
    float* const plane = out + (polarity[i] > 0 ? 0 : pixels * windows);
    share_out(knots, begin, t[i], [&](int64_t window, float share) {
      spread(footprint, width, height, [&](int64_t pixel, int64_t weight) {
        plane[pixel * windows + window] += share * static_cast<float>(weight * kCountUnit);
      });
    });
  }
  const torch::Tensor maps =
      sums.view({2, size.height, size.width, windows}).permute({0, 3, 1, 2}).contiguous();
  return {maps[0], maps[1]};
}

}  // namespace jade::events
