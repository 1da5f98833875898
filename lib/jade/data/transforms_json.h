// SPDX-License-Identifier: Apache-2.0
// Values of a transforms.json. Those of a frame override those of the file. `where` names file and
// frame in messages. All functions throw DataError for values of another type or out of range.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "jade/data/unused_parts.h"
#include "jade/geometry/camera.h"
#include "jade/geometry/lens.h"
#include "jade/geometry/pose.h"

namespace jade::data {

/// The root object of a file.
/// @throws DataError unless it has a list "frames", and no NaN or Infinity.
nlohmann::json read_transforms_json(const std::filesystem::path& path);

/// A string of a frame or of the file; empty if neither has it.
std::string text_of(const nlohmann::json& frame, const char* key, const std::string& where);

/// camera_from_world of a transform_matrix, which is world_from_camera in OpenGL axes: 3x4, or 4x4
/// with the last row 0, 0, 0, 1.
geometry::Pose pose_of_matrix(const nlohmann::json& matrix, const std::string& where);

/// The pinhole of a frame; 0 for missing values. Keys of the frame override those of the file, and
/// its own field of view overrides the file's focal length.
geometry::Intrinsics camera_of_frame(const nlohmann::json& root, const nlohmann::json& frame,
                                     const std::string& where);

/// The field of view along 'x' or 'y' in radians: camera_angle_x, or instant-ngp's x_fov in
/// degrees; 0 if missing. Keys of the frame, also its focal length, override those of the file.
double angle_of(const nlohmann::json& root, const nlohmann::json& frame, char axis,
                const std::string& where);

/// camera_angle_x or _y in radians of the object that contains the focal length; 0 without it.
double angle_beside_focal(const nlohmann::json& root, const nlohmann::json& frame, char axis);

/// camera_model in upper case; empty if missing.
std::string camera_model_of(const nlohmann::json& root, const nlohmann::json& frame);

/// nerfstudio's camera_model with distortion_params or k1 to k6, p1 and p2, or instant-ngp's
/// is_fisheye. Coefficients override the names PINHOLE and SIMPLE_PINHOLE, as in nerfstudio.
/// @throws DataError for cameras that no pinhole can replace.
geometry::Lens lens_of_frame(const nlohmann::json& root, const nlohmann::json& frame,
                             const std::string& where);

/// Adds the keys of a file and of its frames whose value differs from the default.
void add_keys(const nlohmann::json& root, std::set<std::string>& keys);

/// Keys of nerfstudio, instant-ngp, D-NeRF and Spectacular AI that have no effect here.
const std::vector<FormatPart>& unused_keys();

}  // namespace jade::data
