// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "jade/data/exposure.h"

namespace jade::data {

/// The fixed pattern of a frame sensor, estimated from frames taken at different places.
struct PatternEstimate {
  /// Standard deviation of the detail (up to 3 px) that is the same at each pixel of all frames, in
  /// units of white. 0 if no frames could be compared.
  double strength = 0;
  /// Motion of the scene in the image along the direction of least motion, px (standard deviation
  /// over the frames). Along a single line, edges of the scene look like a pattern.
  double sideways_px = 0;
  int64_t pairs = 0;  ///< number of compared pairs of frames

  /// Whether motion in two directions separates the pattern from the scene, and the pattern is
  /// strong enough to learn (docs/results.md, "Fixed pattern").
  bool is_worth_learning() const {
    return sideways_px >= kLeastSidewaysPx && strength >= kLeastStrength;
  }

  static constexpr double kLeastSidewaysPx = 4;
  static constexpr double kLeastStrength = 0.005;
};

/// Compares pairs of training frames in which the scene is shifted by more than 8 px: detail that
/// they have in common is not part of the scene. Ignores frames of another size than the first, and
/// uses at most 64 frames. Uses the poses of the data set at both of its depth bounds.
PatternEstimate estimate_pattern(const Dataset& dataset);

}  // namespace jade::data
