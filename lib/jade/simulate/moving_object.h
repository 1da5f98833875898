// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"
#include "jade/simulate/options.h"
#include "jade/world/frame_source.h"

namespace jade::simulate {

/// A striped ball that swings to and fro before the scene.
class MovingObject {
 public:
  /// @param from  where a camera sees its middle place in the middle of the image
  /// @param depth  of that place
  MovingObject(const ObjectOptions& options, const geometry::Intrinsics& camera,
               const geometry::Pose& from, double depth);

  bool is_there() const { return options_.radius_px > 0; }
  /// Draws it over what is further away.
  void draw(const geometry::Intrinsics& camera, const geometry::Pose& pose, double t_us,
            world::SharpFrame& frame) const;
  /// The time in which it moves by `px` at its fastest, µs.
  double time_for_us(double px) const;

 private:
  geometry::Vector3 centre_at(double t_us) const;

  ObjectOptions options_;
  geometry::Pose world_from_middle_;
  double depth_, radius_, px_;  // world units; of a pixel at that depth
};

}  // namespace jade::simulate
