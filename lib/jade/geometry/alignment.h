// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "jade/geometry/pose.h"

namespace jade::geometry {

/// x_b = scale · rotation · x_a + translation.
struct Similarity {
  double scale = 1;
  Matrix3 rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};
  Vector3 translation{0, 0, 0};
};

/// The similarity that takes the cameras `a` onto the same cameras `b` of another world. The
/// rotation is the chordal mean of the cameras' own, which a path along a straight line does not
/// leave open as its centres would; scale and translation are the least squares over the centres.
/// Cameras that all stand at one place, or whose centres are mirrored, keep scale 1.
/// @param a, b  camera_from_world, as many of one as of the other and at least one
Similarity align_cameras(const std::vector<Pose>& a, const std::vector<Pose>& b);

/// A camera of world a as it stands in world b.
Pose moved(const Pose& camera_from_world, const Similarity& b_from_a);

}  // namespace jade::geometry
