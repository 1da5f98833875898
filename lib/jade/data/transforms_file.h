// SPDX-License-Identifier: Apache-2.0
// One file of the transforms layout: its frames with their images, masks, poses and cameras.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "jade/data/warnings.h"
#include "jade/geometry/camera.h"
#include "jade/geometry/lens.h"
#include "jade/geometry/pose.h"

namespace jade::data {

struct ListedView {
  std::string given;  ///< 'file_path' as in the file, with slashes
  std::filesystem::path path, mask;
  geometry::Pose pose;
  geometry::Intrinsics camera;        ///< 0 if the file does not contain it
  double angle_x = 0, angle_y = 0;    ///< fields of view in radians, used without a focal length
  double beside_x = 0, beside_y = 0;  ///< those stated beside a focal length; 0: none
  double reduction = 1;               ///< camera size / image size, without 'w', 'h'
  geometry::Lens lens;
};

/// A file and the views whose images are there.
struct TransformsFile {
  std::filesystem::path path;
  nlohmann::json root;
  std::vector<ListedView> views;
  std::set<std::string> missing;  ///< 'file_path' of frames without an image
};

/// Whether a coordinate of a principal point is a fraction of the image size instead of px.
bool is_fraction(double place);

/// Reads a file; images are in `image_folder`, unless that is empty.
/// @throws DataError naming the file and frame for malformed JSON, missing keys or most images
///   missing.
TransformsFile read_transforms(const std::filesystem::path& path, const std::string& image_folder,
                               const Warnings& warnings);

/// The images that any of a folder's files names; in `image_folder`, unless that is empty.
std::set<std::filesystem::path> named_images(const std::filesystem::path& folder,
                                             const std::string& image_folder = "");

}  // namespace jade::data
