// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/data/warnings.h"
#include "jade/geometry/origin.h"

namespace jade::data {

/// The origin to which loaders move a scene (geometry/origin.h), from the camera centres.
/// @param points  [P,3] float64 or undefined: the extent of the scene
/// @param depth   its depth if there are no points; 0 if unknown
geometry::Vector3 origin_of(const std::vector<geometry::Pose>& cameras_from_world,
                            const torch::Tensor& points, double depth = 0);

/// Points relative to another origin, subtracted in double. [P,3] of any floating type; returns
/// float64.
torch::Tensor with_origin(const torch::Tensor& points, const geometry::Vector3& origin);

/// Moves a data set from its origin to another: poses, path and points.
void move_origin(Dataset& data, const geometry::Vector3& origin);

/// Adds a note if the data set was moved.
void tell_origin(Dataset& data);

/// The length that training takes as 1, in units of the data set. Step sizes of poses and the noise
/// and the size penalty of MCMC are lengths, and suit depths near 1. Between 0.1 and 10 the unit is
/// 1, as published; other scenes, in millimetres or kilometres for example, have the geometric mean
/// of their depth bounds.
double length_unit(const Dataset& data);

/// Warns of cameras that all have the same centre, or the same pose.
void tell_still_cameras(const Dataset& data, const Warnings& warnings);

}  // namespace jade::data
