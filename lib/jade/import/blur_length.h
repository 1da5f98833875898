// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/events/event_stream.h"

namespace jade::import {

/// Mean length, px, of the image motion during an exposure, estimated from its events alone. In
/// each of some dozens of patches, finds the image velocity that maximises the density of the
/// motion-compensated events (contrast maximisation: Gallego et al., CVPR 2018), from coarse to
/// fine; patches are weighted by their number of events. A patch whose density at no velocity
/// exceeds the chance level counts as static. Accurate to 20 % from 4 px up. Slower motions with
/// few events are within the chance level and are underestimated (2 px as 0.4 to 0.8), as are
/// oscillations within an exposure; motions beyond 64 px are not detected.
/// @param events    of the exposure or more, without hot pixels
/// @param exposure  of the frame, by the events' clock
/// @param size      of the sensor
double blur_px(const events::EventStream& events, const events::TimeWindow& exposure,
               const events::ImageSize& size);

}  // namespace jade::import
