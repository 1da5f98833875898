// SPDX-License-Identifier: Apache-2.0
#include "jade/events/voxel.h"

#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/events/counts.h"

namespace jade::events {

torch::Tensor signed_bins(const EventStream& events, const TimeWindow& window, int64_t bins,
                          const ImageSize& size) {
  JADE_CHECK(bins > 0, "expected one bin or more, found ", bins);
  std::vector<int64_t> knots;
  for (int64_t k = 0; k <= bins; ++k) knots.push_back(knot_us(window, k, bins));
  const auto counts = count_events(events, knots, size);
  return to_events(counts.select(1, 0) - counts.select(1, 1));
}

EventVoxel normalized(const torch::Tensor& sums) {
  check_shape(sums, "voxel sums", {-1, -1, -1});
  const double largest = sums.numel() > 0 ? sums.abs().max().item<double>() : 0;
  if (largest == 0) return {torch::zeros_like(sums), 0};
  // By a tensor: GPUs multiply with the reciprocal of a plain number, which rounds otherwise.
  return {sums / torch::full({}, largest, sums.options()), largest};
}

EventVoxel voxelize(const EventStream& events, const TimeWindow& window, int64_t bins,
                    const ImageSize& size) {
  return normalized(signed_bins(events, window, bins, size));
}

torch::Tensor polarity_projection(const torch::Tensor& voxel) {
  check_shape(voxel, "voxel", {-1, -1, -1});
  return torch::stack({voxel.clamp_min(0).sum(0), voxel.neg().clamp_min(0).sum(0)});
}

}  // namespace jade::events
