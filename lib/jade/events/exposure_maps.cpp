// SPDX-License-Identifier: Apache-2.0
#include "jade/events/exposure_maps.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/events/counts.h"

namespace jade::events {
namespace {

std::vector<int64_t> equal_knots(const TimeWindow& window, int64_t parts) {
  std::vector<int64_t> out;
  for (int64_t k = 0; k <= parts; ++k) out.push_back(knot_us(window, k, parts));
  return out;
}

/// Sums [S,2,H,W] counts between `fine` knots into those between `coarse` knots, a subset.
torch::Tensor merged(const torch::Tensor& counts, const std::vector<int64_t>& fine,
                     const std::vector<int64_t>& coarse) {
  std::vector<torch::Tensor> parts;
  for (size_t k = 0; k + 1 < coarse.size(); ++k) {
    const auto begin = std::lower_bound(fine.begin(), fine.end(), coarse[k]) - fine.begin();
    const auto end = std::lower_bound(fine.begin(), fine.end(), coarse[k + 1]) - fine.begin();
    parts.push_back(counts.slice(0, begin, end).sum(0));
  }
  return torch::stack(parts);
}

}  // namespace

torch::Tensor edi_windows(const WindowCounts& counts, const Thresholds& thresholds) {
  JADE_CHECK(thresholds.positive > 0 && thresholds.negative > 0,
             "expected thresholds above 0, found ", thresholds.positive, " and ",
             thresholds.negative);
  return counts.positive * thresholds.positive - counts.negative * thresholds.negative;
}

ExposureMaps map_exposure(const EventStream& events, const TimeWindow& exposure, int64_t bins,
                          const ImageSize& size, int64_t parts) {
  JADE_CHECK(bins > 0 && parts > 0, "expected one bin and one window or more, found ", bins,
             " and ", parts);
  const auto bin_knots = equal_knots(exposure, bins);
  const auto window_knots = equal_knots(exposure, parts);
  std::vector<int64_t> knots(bin_knots);
  knots.insert(knots.end(), window_knots.begin(), window_knots.end());
  std::sort(knots.begin(), knots.end());
  knots.erase(std::unique(knots.begin(), knots.end()), knots.end());
  if (knots.size() < 2) knots.push_back(knots.front());  // an exposure of no length
  const auto counts = count_events(events, knots, size);
  const auto binned = merged(counts, knots, bin_knots);
  const auto windows = to_events(merged(counts, knots, window_knots));
  ExposureMaps out;
  out.voxel = normalized(to_events(binned.select(1, 0) - binned.select(1, 1)));
  out.windows = {windows.select(1, 0).contiguous(), windows.select(1, 1).contiguous()};
  out.density = to_events(counts.sum(torch::IntArrayRef{0, 1}));
  return out;
}

WindowCounts count_windows(const EventStream& events, const TimeWindow& exposure, int64_t parts,
                           const ImageSize& size) {
  JADE_CHECK(parts > 0, "expected one window or more, found ", parts);
  const auto counts = to_events(count_events(events, equal_knots(exposure, parts), size));
  return {counts.select(1, 0).contiguous(), counts.select(1, 1).contiguous()};
}

}  // namespace jade::events
