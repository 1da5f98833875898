// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/events/event_stream.h"
#include "jade/events/thresholds.h"
#include "jade/events/voxel.h"

namespace jade::events {

/// Time spans between the nine poses of an exposure.
inline constexpr int64_t kEdiWindows = 8;

/// Events of J equal spans of an exposure, t_j = linspace(t_start, t_end, J + 1), by polarity.
struct WindowCounts {
  torch::Tensor positive, negative;  ///< [J,H,W] float32, events
};

/// w_j of the EDI integral: Θ⁺ P_j − Θ⁻ N_j, the change of log intensity over window j.
/// @param counts  consumed: the result takes their memory, as large frames have 236 MB of either
/// @return the shape of the counts, float32
torch::Tensor edi_windows(WindowCounts&& counts, const Thresholds& thresholds);

/// The event maps of an exposure that training uses.
struct ExposureMaps {
  EventVoxel voxel;
  WindowCounts windows;
  torch::Tensor density;  ///< [H,W] float32, events of either polarity
  /// [N,H,W] float32, positive minus negative events of N equal spans; undefined unless requested
  torch::Tensor signed_windows;
};

/// Voxel, EDI windows and density of the events in `exposure`, exact as in count_events.
/// @param events  on the CPU; only events in [begin_us, end_us) count.
/// @param parts   number of windows.
/// @param signed_parts  number of signed windows; 0: none.
ExposureMaps map_exposure(const EventStream& events, const TimeWindow& exposure, int64_t bins,
                          const ImageSize& size, int64_t parts = kEdiWindows,
                          int64_t signed_parts = 0);

}  // namespace jade::events
