// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>

#include "jade/events/event_stream.h"

namespace jade::events {

struct WarpedEvents {
  EventStream events;
  int64_t dropped = 0;  ///< events one pixel or more from every pixel of the image
};

/// Moves events through a map: (x, y) becomes map(x, y), interpolated bilinearly, with float
/// coordinates and the order of time unchanged. Any part of a recording can be warped separately.
/// @param map   [2,h,w] float32 at the event sensor's size, column then row; NaN: no destination
///   (geometry/rectification.h)
/// @param size  of the map's destination image
WarpedEvents warp(const EventStream& events, const torch::Tensor& map, const ImageSize& size);

}  // namespace jade::events
