// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>

#include "jade/events/event_stream.h"

namespace jade::events {

struct WarpedEvents {
  EventStream events;
  int64_t dropped = 0;  ///< that no pixel of the image is within one pixel of
};

/// Moves events through a map: (x, y) becomes map(x, y), bilinear between pixels for sub-pixel
/// coordinates; float coordinates, in order of time as they were. Any part of a recording can be
/// given by itself.
/// @param map   [2,h,w] float32 at the event sensor's size, column then row; NaN: nowhere
///   (geometry/rectification.h)
/// @param size  of the image into which the map leads
WarpedEvents warp(const EventStream& events, const torch::Tensor& map, const ImageSize& size);

}  // namespace jade::events
