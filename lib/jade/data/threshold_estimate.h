// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/data/exposure.h"
#include "jade/events/thresholds.h"

namespace jade::data {

/// Contrast thresholds found in the data, without any truth.
struct ThresholdEstimate {
  events::Thresholds thresholds;
  int64_t pixels = 0;      ///< that spoke
  double residual = 0;     ///< root mean square of what the model leaves, log intensity
  double unexplained = 1;  ///< the same squared, over the change there was: 0 perfect, 1 useless
  bool found = false;      ///< false where there are too few events or frames
};

/// Estimates Θ⁺ and Θ⁻ from neighbouring blurry frames. With Bᵢ the mean of the nine latents
/// Lᵢ exp(J_k), L = log(I + offset),
///     log(B₂ + o) − log(B₁ + o) = Θ⁺ P − Θ⁻ N + log Σ exp J₂ − log Σ exp J₁
/// where P and N count the events between the two mid-exposures. Solved by Gauss-Newton over the
/// pixels of gray frames that are neither dark nor saturated, with weights that let go of pixels
/// that do not fit (Huber). Reads 10 to 20 % high on ideal events, as changes
/// of less than a threshold leave no event, and up to a third off on real recordings: the start of
/// a search, no calibration.
/// @param log_offset  ε of the sensor's log(I + ε), in units of intensity.
ThresholdEstimate estimate_thresholds(const Dataset& dataset, double log_offset);

}  // namespace jade::data
