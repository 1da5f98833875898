// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/events/event_stream.h"

namespace jade::events {

/// Moves events from the raw sensor to the rectified image: (x, y) becomes map(x, y), bilinear
/// between pixels for sub-pixel coordinates. Events beside the sensor get NaN, which nothing
/// counts. Times and polarities are shared with the input.
/// @param map  [2,H,W] float32 at the sensor's size, column then row, as
///             geometry::rectification_map makes it and ev_map.npz holds it (inv_mapx, inv_mapy).
EventStream rectify(const EventStream& events, const torch::Tensor& map);

}  // namespace jade::events
