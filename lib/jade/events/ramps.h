// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "jade/events/exposure_maps.h"

namespace jade::events {

/// Approximates the windows of a sensor without quantisation: log intensity is known at the events
/// of a pixel and lies within one threshold between them, so each event's step is spread linearly
/// over the time since the previous event at the same pixel. The ramp begins at most `reach_us`
/// before the event: after a longer pause the motion started late, or the event is noise. An event
/// after the exposure whose ramp begins inside it counts with the part inside.
///
/// Bilinear as count_events, in float32 and in the order of the events: any number of threads gives
/// the same bits. "The same pixel" is the nearest pixel of the image.
/// @param events    the whole recording, or all from `reach_us` before the exposure to `reach_us`
///   after it; on the CPU.
/// @param reach_us  0 or more; 0 puts each step at its event, as count_events does.
/// @return counts of `parts` equal windows, fractions included.
WindowCounts ramped_windows(const EventStream& events, const TimeWindow& exposure, int64_t parts,
                            int64_t reach_us, const ImageSize& size);

}  // namespace jade::events
