// SPDX-License-Identifier: Apache-2.0
// The region of a scene's cameras, apart from a few wrong poses far away.
#pragma once

#include <limits>
#include <vector>

#include "jade/geometry/pose.h"

namespace jade::geometry {

/// A ball with all camera centres but the stray ones.
struct CameraRegion {
  Vector3 middle{0, 0, 0};  ///< median of the centres along each axis
  double radius = std::numeric_limits<double>::infinity();  ///< infinite: no centre is stray

  bool contains(const Vector3& centre) const;
};

/// Finds centres that are stray: at most a quarter of all, each more than 10 times as far from the
/// middle as the farthest of the others and as the depth of the scene. If the depth is unknown, at
/// most a tenth, 30 times as far. A path that leaves a place in steps has no such gap.
/// @param depth  of the scene seen from the cameras; 0 if unknown
CameraRegion camera_region(const std::vector<Vector3>& centres, double depth);

}  // namespace jade::geometry
