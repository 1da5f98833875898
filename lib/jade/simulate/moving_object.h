// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"
#include "jade/simulate/options.h"
#include "jade/world/frame_source.h"

namespace jade::simulate {

/// A striped ball that oscillates in front of the scene.
class MovingObject {
 public:
  /// @param from  camera that sees the ball's mean position in the image centre
  /// @param depth  of that position
  MovingObject(const ObjectOptions& options, const geometry::Intrinsics& camera,
               const geometry::Pose& from, double depth);

  bool is_there() const { return options_.radius_px > 0; }
  /// Renders the ball over everything farther away.
  void draw(const geometry::Intrinsics& camera, const geometry::Pose& pose, double t_us,
            world::SharpFrame& frame) const;
  /// The time in which it moves by `px` at its highest speed, µs.
  double time_for_us(double px) const;

 private:
  geometry::Vector3 centre_at(double t_us) const;

  ObjectOptions options_;
  geometry::Pose world_from_middle_;
  double depth_, radius_, px_;  // world units; size of a pixel at that depth
};

}  // namespace jade::simulate
