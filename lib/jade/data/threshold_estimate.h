// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "jade/data/event_flip.h"
#include "jade/data/exposure.h"
#include "jade/events/thresholds.h"

namespace jade::data {

/// Contrast thresholds estimated from the data alone.
struct ThresholdEstimate {
  events::Thresholds thresholds;    ///< means over the pixels
  events::Thresholds spread{0, 0};  ///< standard deviation from pixel to pixel
  /// Standard error of the means, by jackknife over parts of the image.
  events::Thresholds standard_error{1e9, 1e9};
  int64_t pixels = 0;      ///< number of usable pixels
  double residual = 0;     ///< residual of the model at a pixel, log intensity (robust standard
                           ///< deviation)
  double frame_noise = 0;  ///< estimated standard deviation of a frame's pixel, in units of white
  double unexplained = 1;  ///< unexplained share of the squared changes: 0 perfect, 1 useless
  bool found = false;      ///< false if there are too few events or frames, or they disagree
  /// Set if thresholds are not found for the events as they are, but without this flip.
  std::optional<EventFlip> flip;
};

/// Estimates Θ⁺ and Θ⁻ from the consistency of neighbouring exposures (event_consistency.h). Within
/// 10 % of the truth on simulated recordings with noise (docs/engineering/import.md).
/// @param exposures   frames and times, in order; poses are not used
/// @param events      of the pixels of these frames, by the same clock
/// @param log_offset  ε of the sensor's log(I + ε), in units of intensity.
/// @throws Interrupted.
ThresholdEstimate estimate_thresholds(const std::vector<Exposure>& exposures,
                                      const events::EventStream& events, double log_offset);

}  // namespace jade::data
