// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "jade/data/exposure.h"

namespace jade::data {

/// The fixed pattern of a frame sensor as frames of different places show it.
struct PatternEstimate {
  /// Standard deviation of what is the same at each pixel of all frames, of detail up to 3 px;
  /// white is 1. 0 where no frames could be compared.
  double strength = 0;
  /// How far the scene moves in the frames in the direction in which it moves least, px (standard
  /// deviation over the frames). Along a single line, edges of the scene look like a pattern.
  double sideways_px = 0;
  int64_t pairs = 0;  ///< of frames that were compared

  /// Whether motion in two directions tells a pattern from the scene, and one is there that is
  /// worth learning (docs/results.md, recordings with faults).
  bool is_worth_learning() const {
    return sideways_px >= kLeastSidewaysPx && strength >= kLeastStrength;
  }

  static constexpr double kLeastSidewaysPx = 4;
  static constexpr double kLeastStrength = 0.005;
};

/// Compares pairs of training frames in which the scene lies at places more than 8 px apart: what
/// their detail has in common is not scene. Frames of another size than the first are left out, and
/// of many frames 64 are used. Uses the poses of the data set at both of its depth bounds.
PatternEstimate estimate_pattern(const Dataset& dataset);

}  // namespace jade::data
