// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/data/warnings.h"
#include "jade/geometry/origin.h"

namespace jade::data {

/// The origin to which loaders move a scene (geometry/origin.h), by the places of its cameras.
/// @param points  [P,3] float64 or undefined: how far away the scene is
/// @param depth   the same where there are no points; 0 where nobody knows
geometry::Vector3 origin_of(const std::vector<geometry::Pose>& cameras_from_world,
                            const torch::Tensor& points, double depth = 0);

/// Points about another origin, subtracted in double. [P,3] of any floating type; float64.
torch::Tensor with_origin(const torch::Tensor& points, const geometry::Vector3& origin);

/// Moves a data set from its origin to another: poses, path and points.
void move_origin(Dataset& data, const geometry::Vector3& origin);

/// Adds to the notes that the data set was moved, if it was.
void tell_origin(Dataset& data);

/// Warns of cameras that all stand at one place, or have one pose.
void tell_still_cameras(const Dataset& data, const Warnings& warnings);

/// Warns of points that lie behind the cameras and are in no picture, as where the axes of the
/// poses are of another convention.
void tell_points_behind(const Dataset& data, const Warnings& warnings);

}  // namespace jade::data
