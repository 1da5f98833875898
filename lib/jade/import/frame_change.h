// SPDX-License-Identifier: Apache-2.0
// Change from one frame to the next, predicted from the events.
#pragma once

#include "jade/data/exposure.h"
#include "jade/events/event_stream.h"

namespace jade::import {

/// The share of an exposure after t, µs: 1 before it to 0 after it, a step for a sharp frame. An
/// event at t changes the logarithm of frame b over frame a, to first order, by its threshold times
/// part_after(b, t) − part_after(a, t).
double part_after(const data::Exposure& exposure, double t_us);

/// Σ polarity · (part_after(b, t) − part_after(a, t)) at each pixel, [H,W] float32; coordinates are
/// rounded to the nearest pixel.
torch::Tensor event_change(const data::Exposure& a, const data::Exposure& b,
                           const events::EventStream& events);

}  // namespace jade::import
