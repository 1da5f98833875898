// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/event_stream.h"

namespace jade::import {

/// Detects events whose y axis, x axis or both are reversed relative to the frames: mirrored events
/// correlate with the changes of the frames at least twice as well as the original ones
/// (estimate_clock_offset). Returns which axis and how to fix it, or an empty text.
/// @param exposures    frames and times in order, with or without a length
/// @param events       on the pixels of the frames
/// @param correlation  ClockOffset::correlation of the original events
std::string find_mirroring(const std::vector<data::Exposure>& exposures,
                           const events::EventStream& events, double correlation);

}  // namespace jade::import
