// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/event_stream.h"

namespace jade::import {

struct ClockOffsetOptions {
  double reach_ms = 50;  ///< offsets from −reach to +reach are tried
  double step_ms = 1;
  int64_t pairs = 24;  ///< neighbouring frames that are looked at, at most
};

/// How far the clock of the events is ahead of that of the frames.
struct ClockOffset {
  double offset_us = 0;  ///< light of frame time t made its events at event time t + offset
  /// Standard error, from leaving out parts of the frames (jackknife), µs.
  double error_us = 0;
  double correlation = 0;  ///< at the peak, of frame changes with event sums: 1 is perfect
  double second = 0;       ///< of the next peak; 0 if there is none
  int64_t pairs = 0;       ///< of frames that were used
  /// Why the offset must not be used; empty where it may.
  std::string doubt;
  std::vector<double> curve;  ///< the correlation at every offset tried, in order

  bool ambiguous() const { return !doubt.empty(); }
};

/// Finds the offset at which events explain best how frames change. Between neighbouring frames
/// the logarithm of a patch changes by about Σ polarity · (c₂(t) − c₁(t)), where c(t) is the part
/// of an exposure that comes after an event at t; this sum at shifted times is correlated with the
/// change over all patches and pairs, and a parabola through the peak gives the offset. Events
/// count at half the time since the one before, as a pixel speaks only once a change is complete.
/// In doubt where nothing correlates (a camera or scene that stands still), where another peak is
/// nearly as high (a steady motion over a repeating texture), where the peak lies at the end of the
/// range, and where parts of the frames disagree.
/// @param exposures  frames and times by the frames' clock, in order; poses are not used
/// @param events     of the same sensor, whole-pixel or rectified coordinates
ClockOffset estimate_clock_offset(const std::vector<data::Exposure>& exposures,
                                  const events::EventStream& events,
                                  const ClockOffsetOptions& options = {});

}  // namespace jade::import
