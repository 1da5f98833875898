// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/events/event_stream.h"

namespace jade::import {

/// Counts events per pixel of the raw sensor in a streaming way: a recording of any length needs
/// the memory of one image.
class PixelCounter {
 public:
  explicit PixelCounter(const events::ImageSize& size);

  /// Coordinates are rounded to the nearest pixel; events outside the sensor are ignored.
  void add(const events::EventStream& events);

  torch::Tensor counts() const { return counts_; }  ///< [H,W] int64
  double seconds() const;  ///< from the first event to the last; 0 without events

 private:
  torch::Tensor counts_;
  int64_t first_us_ = INT64_MAX, last_us_ = INT64_MIN;
};

struct HotPixel {
  int64_t row = 0, column = 0;
  double rate_hz = 0;        ///< event rate of this pixel
  double neighbours_hz = 0;  ///< median rate of the pixels around it
};

struct HotPixels {
  std::vector<HotPixel> pixels;  ///< by rate, the highest first
  torch::Tensor mask;            ///< [H,W] bool
};

/// Finds pixels that fire without a cause: more than eight times as often as the median of all
/// pixels and as the median of the 24 around them, and more than eight standard deviations of a
/// count above the larger of the two. Both medians leave out pixels without events, which scaling
/// to a finer image makes, if enough remain. A moving textured scene activates neighbours alike,
/// whereas defects are isolated or in small groups.
HotPixels find_hot_pixels(const PixelCounter& counter);

/// The events of pixels outside the mask. Any part of a recording can be processed separately.
events::EventStream remove_events(const events::EventStream& events, const torch::Tensor& mask);

}  // namespace jade::import
