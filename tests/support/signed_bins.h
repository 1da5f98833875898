// SPDX-License-Identifier: Apache-2.0
// V(E) bin by bin, as in Eq. (1): the reference of events::map_exposure.
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/events/counts.h"
#include "jade/events/voxel.h"

namespace jade::test {

/// Counts by bin and polarity, [T,2,H,W], on the events' device.
inline torch::Tensor binned(const events::EventStream& events, const events::TimeWindow& window,
                            int64_t bins, const events::ImageSize& size) {
  std::vector<int64_t> knots;
  for (int64_t k = 0; k <= bins; ++k) knots.push_back(events::knot_us(window, k, bins));
  return events::count_events(events, knots, size);
}

/// Signed sums before division, [T,H,W] float32 in events, on the events' device.
inline torch::Tensor signed_bins(const events::EventStream& events,
                                 const events::TimeWindow& window, int64_t bins,
                                 const events::ImageSize& size) {
  const torch::Tensor counts = binned(events, window, bins, size);
  return events::to_events(counts.select(1, 0) - counts.select(1, 1));
}

inline events::EventVoxel voxelize(const events::EventStream& events,
                                   const events::TimeWindow& window, int64_t bins,
                                   const events::ImageSize& size) {
  return events::normalized(signed_bins(events, window, bins, size));
}

}  // namespace jade::test
