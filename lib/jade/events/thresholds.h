// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/core/fields.h"

namespace jade::events {

/// Contrast thresholds Θ⁺ and Θ⁻: the change of log intensity that one event of each polarity
/// reports.
struct Thresholds {
  double positive = 0.25, negative = 0.25;
};

/// Time bins of the voxel over an exposure, as in the paper. An even number, so that mid-exposure
/// falls between two bins.
constexpr int64_t kVoxelBins = 6;

/// How events are read and summed; the configuration group `events`.
struct EventOptions {
  AutoNumber threshold_positive = AutoNumber::automatic(0.25);
  double threshold_negative = 0;
  int64_t edi_samples = 65;
  double ramp_ms = 5;

  /// The thresholds of both polarities: a negative threshold of 0 repeats the positive one. A
  /// positive threshold of auto counts as 0.25 until it is measured (run/thresholds.h).
  Thresholds thresholds() const {
    const double positive = threshold_positive;
    return {positive, threshold_negative > 0 ? threshold_negative : positive};
  }
};

template <class V>
void describe(V& v, EventOptions& o) {
  v.field("threshold_positive", o.threshold_positive,
          "change of log intensity per positive event; auto: measured from frames and events, 0.25 "
          "if that fails",
          Range{1e-4, 10});
  v.field("threshold_negative", o.threshold_negative,
          "change of log intensity per negative event; 0: as threshold_positive, measured "
          "separately if that is auto",
          Range{0, 10});
  v.fixed("bins", kVoxelBins);
  v.field(
      "edi_samples", o.edi_samples,
      "moments of the EDI integral, odd, by the trapezoid rule; 0: those of exposure.samples by "
      "exposure.quadrature, as printed",
      Range{0, 1025});
  v.field("ramp_ms", o.ramp_ms,
          "EDI spreads an event's step over the time since the previous event at its pixel, at "
          "most this long, ms; 0: a step at the event, as printed",
          Range{0, 1e4});
}

}  // namespace jade::events
