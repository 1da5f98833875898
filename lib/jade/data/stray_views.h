// SPDX-License-Identifier: Apache-2.0
// Views with a wrong pose far from all others, which must not define the size of the scene.
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/data/warnings.h"
#include "jade/geometry/camera_region.h"

namespace jade::data {

/// The region of all cameras but those far from all others.
/// @param points  [P,3] or undefined: the scene
/// @param depth   its depth if there are no points; 0 if unknown
geometry::CameraRegion camera_region(const std::vector<geometry::Pose>& poses,
                                     const torch::Tensor& points, double depth = 0);

/// The poses in that region.
std::vector<geometry::Pose> without_strays(const std::vector<geometry::Pose>& poses,
                                           const torch::Tensor& points, double depth = 0);

/// Sets Exposure::stray, and warns with the names of all views that lie far from the others.
void mark_strays(Dataset& data, const Warnings& warnings);

}  // namespace jade::data
