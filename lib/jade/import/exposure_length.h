// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/events/event_stream.h"
#include "jade/recording/exposures.h"

namespace jade::import {

/// One frame with a single time.
struct StampedFrame {
  torch::Tensor image;  ///< [3,H,W]
  int64_t t_us = 0;
};

/// How long frames were exposed, and which instant of the exposure their stamp is.
struct ExposureLength {
  int64_t length_us = 0;
  recording::Stamp stamp = recording::Stamp::kMiddle;
  /// Standard error of the length, from leaving out parts of the image; 0: unknown.
  double error_us = 0;
  /// How badly frames and events agree, a difference of 1 being e^½ in the likelihood of a change:
  /// at each length that was tried, with the stamp that is best there.
  std::vector<double> lengths_us, losses;
  /// Why the length must not be used; empty where it may.
  std::string doubt;

  bool ambiguous() const { return !doubt.empty(); }
};

/// The median time from a frame to the next, µs; 0 for fewer than two frames. No exposure is
/// longer.
int64_t frame_period_us(const std::vector<int64_t>& stamps_us);

/// Finds the length and the stamp with which the events explain best how each frame differs from
/// the one before it (data::EventConsistency): the blur of a frame is the mean over its exposure of
/// what the events tell. Lengths from a twentieth of the frame period to the whole are tried. In
/// doubt where nothing explains the frames, and where lengths explain them alike: a camera or scene
/// that stands still, or motion without blur.
/// @param frames  by time, on the clock of the events
/// @param stamp   absent: start, middle and end are tried
/// @throws Interrupted.
ExposureLength estimate_exposure_length(const std::vector<StampedFrame>& frames,
                                        const events::EventStream& events,
                                        std::optional<recording::Stamp> stamp);

}  // namespace jade::import
