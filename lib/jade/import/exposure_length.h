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

/// Exposure time of the frames, and the instant of the exposure that their time stamp marks.
struct ExposureLength {
  int64_t length_us = 0;
  recording::Stamp stamp = recording::Stamp::kMiddle;
  /// Standard error of the length, by jackknife over parts of the image; 0: unknown.
  double error_us = 0;
  /// Disagreement of frames and events at each tried length, for the best stamp there; a difference
  /// of 1 is a factor e^½ in the likelihood of a change.
  std::vector<double> lengths_us, losses;
  /// Why the length must not be used; empty if it may be.
  std::string doubt;

  bool ambiguous() const { return !doubt.empty(); }
};

/// Finds the length and the stamp at which the events best explain the change from each frame to
/// the next (data::EventConsistency): the blur of a frame is the mean over its exposure of the
/// brightness that the events imply. Tries lengths from a twentieth of the frame period to the
/// whole. The result is doubtful if no length explains the frames, or if all explain them equally:
/// a static camera or scene, or motion without blur.
/// @param frames  sorted by time, on the clock of the events
/// @param stamp   no value: tries start, middle and end
/// @throws Interrupted.
ExposureLength estimate_exposure_length(const std::vector<StampedFrame>& frames,
                                        const events::EventStream& events,
                                        std::optional<recording::Stamp> stamp);

}  // namespace jade::import
