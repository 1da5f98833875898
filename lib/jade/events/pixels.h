// SPDX-License-Identifier: Apache-2.0
// The pixel nearest to an event.
#pragma once

#include <torch/types.h>

#include "jade/events/event_stream.h"

namespace jade::events {

/// Index of the pixel nearest to (x, y), row by row; -1 outside the image and for NaN.
inline int64_t pixel_of(float x, float y, const ImageSize& size) {
  // Conversion to integers rounds down, because neither is negative.
  const float column = x + 0.5f, row = y + 0.5f;
  const bool inside =
      column >= 0 && column < float(size.width) && row >= 0 && row < float(size.height);
  return inside ? int64_t(row) * size.width + int64_t(column) : -1;
}

/// Number of events at each pixel, [H,W] int64, without those outside.
torch::Tensor pixel_counts(const EventStream& events, const ImageSize& size);

/// The events whose nearest pixel is true in the mask, and those outside the image, [N] bool.
/// @param mask  [H,W] bool
torch::Tensor kept_by(const torch::Tensor& mask, const EventStream& events);

}  // namespace jade::events
