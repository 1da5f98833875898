// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/event_stream.h"

namespace jade::import {

/// How bright each frame is of the same scene, for cameras that adjust exposure time or gain
/// themselves: the steps from frame to frame that events do not tell (data::ConsistencyFit::steps),
/// added up. A steady drift is not among them, as events of leaking pixels make one.
/// @param exposures  frames and times, in order; poses are not used
/// @return one gain for each, with a geometric mean of 1; none where gains would differ by less
/// than
///   a twentieth or by what noise makes
/// @throws Interrupted.
std::vector<double> estimate_frame_gains(const std::vector<data::Exposure>& exposures,
                                         const events::EventStream& events);

}  // namespace jade::import
