// SPDX-License-Identifier: Apache-2.0
// LLFF's poses_bounds.npy: rows of a 3×5 matrix [R | t | (height, width, focal)] and two depths.
#pragma once

#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/geometry/pose.h"

namespace jade::data {

struct LlffView {
  geometry::Pose camera_from_world;  ///< OpenCV axes
  double height = 0, width = 0, focal_px = 0;
  double near = 0, far = 0;  ///< world units
};

/// Converts [N,17] to poses. LLFF stores world_from_camera with columns (down, right, backwards);
/// this library uses camera_from_world with axes (right, down, forward).
/// @param name  the path, for messages.
/// @throws DataError naming the row for other shapes, values that are not finite and matrices that
///   are no rotation.
std::vector<LlffView> parse_llff(const torch::Tensor& rows, const std::string& name);

std::vector<LlffView> read_llff(const std::filesystem::path& path);

/// The inverse of parse_llff: [N,17] float64.
torch::Tensor llff_rows(const std::vector<LlffView>& views);

}  // namespace jade::data
