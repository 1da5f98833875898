// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "jade/core/words.h"
#include "jade/data/exposure.h"
#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"

namespace jade::data {

/// One view to render.
struct NamedCamera {
  std::string name;
  geometry::Pose camera_from_world;
  geometry::Intrinsics camera;
};

/// Reads views from JSON: a list of objects, or an object whose "cameras" is that list and whose
/// other keys are defaults for every entry. An entry has "width", "height", "fx", "fy" (default:
/// fx), "cx", "cy" (default: the image centre), "name" or "img_name" (default: its number), and its
/// pose as "camera_from_world" (4×4 or 3×4 rows, OpenCV axes) or, as 3DGS trainers write it, as
/// "position" (camera centre) with "rotation" (3×3 world_from_camera). An entry with both forms has
/// the pose of "camera_from_world". Other keys are refused; in entries without "camera_from_world"
/// only those that look like a misspelt one.
/// @throws DataError naming the file and the entry, also if its two forms differ.
std::vector<NamedCamera> read_cameras(const std::filesystem::path& path);

/// Writes views in that form, poses in both ways without loss of precision, so that viewers of 3DGS
/// read the file.
void write_cameras(const std::filesystem::path& path, const std::vector<NamedCamera>& cameras);

/// Which views of a data set.
enum class CameraSet { kTest, kTrain, kExposure };

constexpr auto words_of(CameraSet) {
  return std::array{Word{"test", CameraSet::kTest},
                    Word{"train", CameraSet::kTrain, "middle poses of the exposures"},
                    Word{"exposure", CameraSet::kExposure, "nine poses each"}};
}

/// The views of a data set. kExposure returns NAME_0 to NAME_8 of the exposure `name` (training or
/// held out), or of all training exposures if `name` is empty.
/// @throws DataError if there are none.
std::vector<NamedCamera> dataset_cameras(const Dataset& dataset, CameraSet which,
                                         const std::string& name);

}  // namespace jade::data
