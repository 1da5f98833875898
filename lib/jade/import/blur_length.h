// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/events/event_stream.h"

namespace jade::import {

/// Mean length of the way that the picture moves during an exposure, px, found in its events alone.
/// In each of some dozen patches the image velocity is sought at which the events, moved back
/// along it, lie densest (contrast maximisation: Gallego et al., CVPR 2018), from coarse to fine;
/// patches count by their events. A patch whose events lie no denser along any velocity than chance
/// allows counts as standing still. Within 20 % from 4 px up. Slower motions
/// of few events drown in what chance allows and are seen too short (2 px as 0.4 to 0.8), as are
/// motions to and fro within an exposure; those beyond 64 px are not seen at all.
/// @param events    of the exposure or more, without hot pixels
/// @param exposure  of the frame, by the events' clock
/// @param size      of the sensor
double blur_px(const events::EventStream& events, const events::TimeWindow& exposure,
               const events::ImageSize& size);

}  // namespace jade::import
