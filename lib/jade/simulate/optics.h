// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "jade/simulate/options.h"
#include "jade/world/frame_source.h"

namespace jade::simulate {

/// Light path in front of a sensor: scene brightness, flickering lamps, vignetting, and dust.
class Optics {
 public:
  Optics(const SimulateOptions& options, int64_t width, int64_t height, uint64_t seed);

  /// Whether light() changes a picture.
  bool changes() const { return options_.light.brightness != 1 || !passed_.empty() || flickers(); }
  bool flickers() const { return options_.light.flicker > 0; }

  /// Light of the scene relative to its mean over time.
  double flicker_at(double t_us) const;
  /// The time over which flicker_at() is nearly linear, µs.
  double flicker_step_us() const;

  /// `frame` as it reaches the sensor. `lit` may be `frame`.
  void light(const world::SharpFrame& frame, double t_us, world::SharpFrame& lit) const;
  /// Applies the scene's brightness only.
  void brighten(world::SharpFrame& frame) const;

 private:
  void scale(const world::SharpFrame& frame, double factor, const std::vector<float>& map,
             world::SharpFrame& scaled) const;

  SimulateOptions options_;
  std::vector<float> passed_;  // [H*W] transmitted share of the light, or empty
};

/// Interpolates linearly between two pictures. @param share  of `after`
void mix(const world::SharpFrame& before, const world::SharpFrame& after, float share,
         world::SharpFrame& mixed);

}  // namespace jade::simulate
