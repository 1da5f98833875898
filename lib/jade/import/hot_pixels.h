// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "jade/events/event_stream.h"

namespace jade::import {

struct HotPixel {
  int64_t row = 0, column = 0;
  double rate_hz = 0;        ///< event rate of this pixel
  double neighbours_hz = 0;  ///< median rate of the pixels around it
};

/// Finds pixels that fire without a cause: more than eight times as often as the median of all
/// pixels and as the median of the 24 around them, and more than eight standard deviations of a
/// count above the larger of the two. Both medians leave out pixels without events, which scaling
/// to a finer image makes, if enough remain. A moving textured scene activates neighbours alike,
/// whereas defects are isolated or in small groups.
/// @return by rate, the highest first
std::vector<HotPixel> find_hot_pixels(const events::EventStream& events,
                                      const events::ImageSize& sensor);

}  // namespace jade::import
