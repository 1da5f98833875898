// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/geometry/pose.h"

namespace jade::data {

/// One image of a folder.
struct Frame {
  std::string name;     ///< without extension
  torch::Tensor image;  ///< [3,H,W]
};

/// The folder of the frames: `wanted` if given, else the first of images_1, images and images_N
/// that holds images.
/// @throws DataError if there is none.
std::filesystem::path find_image_folder(const std::filesystem::path& root,
                                        const std::string& wanted);

/// The N of a folder named images_N, else 1: how much smaller its images are than the poses say.
double folder_scale(const std::filesystem::path& image_folder);

/// Reads the given images, on several threads, into the given order.
/// @throws DataError if one cannot be read or they differ in size.
std::vector<Frame> read_frames(const std::vector<std::filesystem::path>& paths);

/// Depth bounds around a point cloud as seen from the cameras: the 0.5 % and 99.5 % quantiles of
/// depth with a tenth of room. (0.01, 100) times the spread of the cameras if there are no points
/// in front of them.
struct DepthBounds {
  double near = 0, far = 0;
};
DepthBounds depth_bounds(const torch::Tensor& points, const std::vector<geometry::Pose>& poses);

}  // namespace jade::data
