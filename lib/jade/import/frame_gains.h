// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/event_stream.h"

namespace jade::import {

/// Estimates the relative brightness of each frame, for cameras that adjust exposure time or gain
/// automatically: sums the steps between frames that events do not explain
/// (data::ConsistencyFit::steps). Ignores a steady drift, which events of leaking pixels also
/// cause. A frame that differs from both of its neighbours, which are alike (a lost or a lit one),
/// has a gain of its own and does not change those of the others.
/// @param exposures  frames and times, in order; poses are not used
/// @return one gain per frame, around 1; empty if gains differ by less than a
///   twentieth or by no more than noise
/// @throws Interrupted.
std::vector<double> estimate_frame_gains(const std::vector<data::Exposure>& exposures,
                                         const events::EventStream& events);

}  // namespace jade::import
