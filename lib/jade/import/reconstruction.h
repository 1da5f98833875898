// SPDX-License-Identifier: Apache-2.0
// Poses and points that structure from motion found.
#pragma once

#include <cstdint>
#include <filesystem>
#include <torch/types.h>
#include <vector>

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"
#include "jade/import/latents.h"
#include "jade/import/pose_path.h"

namespace jade::import {

/// A pose that was found.
struct TimedPose {
  int64_t t_us = 0;
  int64_t shot = 0;          ///< index in Capture::shots
  geometry::Pose pose;       ///< camera_from_world
  int64_t observations = 0;  ///< number of scene points observed in its image
};

/// A reconstruction. Lengths are in units of the median depth of its points.
struct Reconstruction {
  geometry::Intrinsics camera;   ///< of the shots
  std::vector<TimedPose> poses;  ///< sorted by time
  torch::Tensor points;          ///< [P,3] float64
  torch::Tensor colors;          ///< [P,3] uint8
  torch::Tensor point_errors;    ///< [P] float64, px of the shots
  /// Indices of the poses that observe each point.
  std::vector<std::vector<int64_t>> seen_by;
};

/// Converts a COLMAP model to a reconstruction.
/// @param scale  size of COLMAP's images relative to the shots
Reconstruction read_reconstruction(const std::filesystem::path& model,
                                   const std::vector<LatentImage>& images, double scale);

/// The camera path through the poses of a capture; poses closer in time than an eighth of its
/// shortest exposure are merged.
PosePath path_of(const std::vector<TimedPose>& poses, const Capture& capture);

/// Point of an index in Reconstruction::points.
geometry::Vector3 point_at(const torch::Tensor& points, int64_t index);

/// Median over the points of the largest angle, degrees, between the ray of the first image that
/// sees the point and those of the others.
double median_parallax(const Reconstruction& reconstruction);

}  // namespace jade::import
