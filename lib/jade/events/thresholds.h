// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/core/fields.h"

namespace jade::events {

/// Contrast thresholds Θ⁺ and Θ⁻: log intensity that one event of each polarity stands for.
struct Thresholds {
  double positive = 0.25, negative = 0.25;
};

/// How events are read and summed; the configuration group `events`.
struct EventOptions {
  double threshold_positive = 0.25;
  double threshold_negative = 0;
  int64_t bins = 6;
  int64_t edi_samples = 65;
  double ramp_ms = 5;

  /// One number sets both: a negative threshold of 0 repeats the positive one.
  Thresholds thresholds() const {
    return {threshold_positive, threshold_negative > 0 ? threshold_negative : threshold_positive};
  }
};

template <class V>
void describe(V& v, EventOptions& o) {
  v.field("threshold_positive", o.threshold_positive,
          "log intensity of one positive event (0.25 CDAVIS, 0.2 Blender)", Range{1e-4, 10});
  v.field("threshold_negative", o.threshold_negative,
          "log intensity of one negative event; 0 repeats threshold_positive", Range{0, 10});
  v.field("bins", o.bins, "time bins of the voxel over an exposure, even", Range{2, 64});
  v.field(
      "edi_samples", o.edi_samples,
      "moments of the EDI integral, odd, by the trapezoid rule; 0: those of exposure.samples by "
      "exposure.quadrature, as printed",
      Range{0, 1025});
  v.field(
      "ramp_ms", o.ramp_ms,
      "EDI spreads an event's step over the time since the event before it at its pixel, but at "
      "most this long, ms; 0: a step at the event, as printed",
      Range{0, 1e4});
}

}  // namespace jade::events
