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

/// The similarity that maps the cameras `a` to the same cameras `b` of another world. The rotation
/// is the chordal mean of the cameras' relative rotations: centres on a straight line would leave
/// it ambiguous. Scale and translation minimise the squared distances of the centres. If all
/// cameras have one centre, or the centres are mirrored, the scale is 1.
/// @param a, b  camera_from_world, of equal, non-zero number
Similarity align_cameras(const std::vector<Pose>& a, const std::vector<Pose>& b);

/// Transforms a camera of world a to world b.
Pose moved(const Pose& camera_from_world, const Similarity& b_from_a);

}  // namespace jade::geometry
