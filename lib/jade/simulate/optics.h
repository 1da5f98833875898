// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "jade/simulate/options.h"
#include "jade/world/frame_source.h"

namespace jade::simulate {

/// Light path before a sensor: scene brightness, lamps that flicker, a lens that loses light in its
/// corners, and dust.
class Optics {
 public:
  Optics(const SimulateOptions& options, int64_t width, int64_t height, uint64_t seed);

  /// Whether light() changes a picture.
  bool changes() const { return options_.light.brightness != 1 || !passed_.empty() || flickers(); }
  bool flickers() const { return options_.light.flicker > 0; }

  /// How much of the scene's light there is, of its mean over time.
  double flicker_at(double t_us) const;
  /// The time over which flicker_at() is nearly straight, µs.
  double flicker_step_us() const;

  /// `frame` as it falls on the sensor. `lit` may be `frame`.
  void light(const world::SharpFrame& frame, double t_us, world::SharpFrame& lit) const;
  /// The scene at its brightness, without the rest.
  void brighten(world::SharpFrame& frame) const;

 private:
  void scale(const world::SharpFrame& frame, double factor, const std::vector<float>& map,
             world::SharpFrame& scaled) const;

  SimulateOptions options_;
  std::vector<float> passed_;  // [H*W] part of the light that passes, or empty
};

/// The values of a picture between two, on straight lines. @param share  of `after`
void mix(const world::SharpFrame& before, const world::SharpFrame& after, float share,
         world::SharpFrame& mixed);

}  // namespace jade::simulate
