// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/event_stream.h"

namespace jade::import {

/// Looks for events whose y axis, x axis or both run against those of the frames. Says which, and
/// how to mend it, where mirrored events follow the changes of the frames at least twice as well as
/// the events as they are (estimate_clock_offset); empty otherwise.
/// @param exposures    frames and times in order, with or without a length
/// @param events       on the pixels of the frames
/// @param correlation  ClockOffset::correlation of the events as they are
std::string find_mirroring(const std::vector<data::Exposure>& exposures,
                           const events::EventStream& events, double correlation);

}  // namespace jade::import
