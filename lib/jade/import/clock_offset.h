// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/event_stream.h"

namespace jade::import {

struct ClockOffsetOptions {
  double reach_ms = 50;  ///< tries offsets from −reach to +reach
  double step_ms = 1;
  int64_t pairs = 24;  ///< neighbouring frames to compare, at most
};

/// Offset of the clock of the events relative to that of the frames.
struct ClockOffset {
  double offset_us = 0;  ///< an image change at frame time t causes events at event time t + offset
  /// Standard error, µs: that of `scatter_us`, of the pixels' latency, and of the correction of the
  /// events' lags, which grows with the time from one event of a pixel to the next.
  double error_us = 0;
  double scatter_us = 0;   ///< standard error by jackknife over parts of the frames
  double correlation = 0;  ///< of frame changes with event sums at the peak: 1 is perfect
  double second = 0;       ///< correlation at the second peak; 0 if there is none
  int64_t pairs = 0;       ///< number of compared pairs of frames
  /// Why the offset must not be used; empty if it may be.
  std::string doubt;
  std::vector<double> curve;  ///< the correlation at every tried offset, in order

  bool ambiguous() const { return !doubt.empty(); }
};

/// Finds the offset at which events best explain how frames change. Between neighbouring frames the
/// logarithm of a patch changes by about Σ polarity · (c₂(t) − c₁(t)), where c(t) is the share of
/// an exposure after an event at t. This sum at shifted times is correlated with the change over
/// all patches and pairs, and a parabola through the peak gives the offset. Events count at the
/// midpoint between their time and that of the previous event, because a pixel fires only when a
/// change is complete. The result is doubtful if nothing correlates (a static camera or scene), if
/// another peak is nearly as high (a steady motion over a repeating texture), if the peak is at the
/// end of the range, or if parts of the frames disagree.
/// @param exposures  frames and times by the frames' clock, in order; poses are not used
/// @param events     of the same sensor, whole-pixel or rectified coordinates
ClockOffset estimate_clock_offset(const std::vector<data::Exposure>& exposures,
                                  const events::EventStream& events,
                                  const ClockOffsetOptions& options = {});

/// Clocks of frames and events that run at different rates.
struct ClockDrift {
  double begin_us = 0, end_us = 0;  ///< offset in the first and in the last part that shows one
  double rate = 0;                  ///< growth of the offset per time of the frames' clock
  bool found = false;
};

/// Estimates the offset of parts of the recording, and fits a line through those without doubt. A
/// drift is found if three parts or more follow the line, and its change is at least 3 ms and five
/// standard errors. Offsets beyond the reach are not seen: if few of the parts show an offset,
/// looks at parts near the beginning. Parameters as in estimate_clock_offset(); `pairs` is for each
/// part.
ClockDrift estimate_clock_drift(const std::vector<data::Exposure>& exposures,
                                const events::EventStream& events,
                                const ClockOffsetOptions& options = {50, 1, 4});

}  // namespace jade::import
