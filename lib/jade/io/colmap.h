// SPDX-License-Identifier: Apache-2.0
// COLMAP sparse models: cameras, images and points3D as .bin or .txt.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::io {

struct ColmapCamera {
  int64_t id = 0;
  std::string model;  ///< "PINHOLE", "SIMPLE_RADIAL", …; any model of COLMAP 4
  int64_t width = 0, height = 0;
  std::vector<double> parameters;  ///< px, in COLMAP's order for the model
};

struct ColmapImage {
  int64_t id = 0;
  std::array<double, 4> rotation{1, 0, 0, 0};  ///< camera_from_world quaternion, wxyz
  std::array<double, 3> translation{0, 0, 0};  ///< camera_from_world
  int64_t camera_id = 0;
  std::string name;  ///< file name as given to COLMAP
};

struct ColmapModel {
  std::vector<ColmapCamera> cameras;
  std::vector<ColmapImage> images;  ///< in file order
  torch::Tensor points;             ///< [P,3] float64, world axes
  torch::Tensor point_colors;       ///< [P,3] uint8 RGB
  torch::Tensor point_errors;       ///< [P] float64, mean reprojection error, px; NaN: unknown
  /// Ids of the images that observe each point, once per observation.
  std::vector<std::vector<int64_t>> point_images;

  /// @throws DataError if an image names a camera that does not exist.
  const ColmapCamera& camera(int64_t id) const;
};

/// The raw content of a model's three files.
struct ColmapFiles {
  std::string cameras, images, points;
  bool binary = true;
  std::string name;  ///< the folder, for messages
};

/// True if `folder` contains cameras and images, binary or text.
bool is_colmap_model(const std::filesystem::path& folder);

/// Number of images of the model in `folder`, without reading them; 0 without a model. May be wrong
/// for a damaged text file.
int64_t count_colmap_images(const std::filesystem::path& folder);

/// Reads binary files if both cameras.bin and images.bin exist, else text. If the points3D file of
/// that kind is missing or has no points, that of the other kind is read; without either there are
/// no points.
/// @throws DataError naming the file for truncated, damaged or contradictory content, non-finite
///   numbers, zero rotations, two cameras or images with one id, an unknown camera model.
ColmapModel read_colmap(const std::filesystem::path& folder);

/// Parses a model from memory.
ColmapModel parse_colmap(const ColmapFiles& files);

}  // namespace jade::io
