// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/thresholds.h"

namespace jade::data {

/// Contrast thresholds found in the data, without any truth.
struct ThresholdEstimate {
  events::Thresholds thresholds;    ///< means over the pixels
  events::Thresholds spread{0, 0};  ///< standard deviation from pixel to pixel
  int64_t pixels = 0;               ///< that spoke
  double residual = 0;     ///< what the model leaves at a pixel, log intensity (robust deviation)
  double unexplained = 1;  ///< share of the squared changes that is left: 0 perfect, 1 useless
  bool found = false;      ///< false where there are too few events or frames, or they disagree
};

/// Estimates Θ⁺ and Θ⁻ by consistency between neighbouring exposures. With E(t) = Θ⁺P(t) − Θ⁻N(t),
/// the events of a pixel until t, and o the sensor's offset,
///     log(B₂ + o) − log(B₁ + o) = log mean₂ exp E − log mean₁ exp E,
/// where the means are over the exposures (trapezoid rule). Every pixel has thresholds of its own:
/// over a span of P and N events a deviation δ of them adds δ⁺P − δ⁻N, which after some dozens of
/// events drowns what the frames tell and pulls a fit of one pair of thresholds for all pixels far
/// down. So the pixels' thresholds are random effects about the mean that is sought (a non-linear
/// mixed model: M. Lindstrom, D. Bates, Biometrics 1990), whose spread and noise are estimated with
/// it (EM); changes that do not fit count less (Huber).
/// Within 10 % of the truth on simulated recordings with noise (docs/own-recording.md).
/// @param exposures   frames and times, in order; poses are not used
/// @param events      of the pixels of these frames, by the same clock
/// @param log_offset  ε of the sensor's log(I + ε), in units of intensity.
/// @throws Interrupted.
ThresholdEstimate estimate_thresholds(const std::vector<Exposure>& exposures,
                                      const events::EventStream& events, double log_offset);

}  // namespace jade::data
