// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/event_stream.h"

namespace jade::import {

/// Looks for events whose axes or polarity differ from those of the frames (data::EventFlip).
/// Returns the flip and its cure if the events without it correlate at least twice as well with the
/// changes of the frames (estimate_clock_offset); otherwise an empty string.
/// @param exposures    frames and times in order, with or without a length
/// @param events       on the pixels of the frames
/// @param correlation  ClockOffset::correlation of the events as they are
std::string find_flip(const std::vector<data::Exposure>& exposures,
                      const events::EventStream& events, double correlation);

}  // namespace jade::import
