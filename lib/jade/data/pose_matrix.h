// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "jade/geometry/pose.h"

namespace jade::data {

/// The rotation and translation of a matrix in JSON, as they are: 3x4, or 4x4 with the last row
/// 0, 0, 0, 1, whose 3x3 part is a rotation up to rounding.
/// @param expected  a message up to what was found
/// @throws DataError with what was found, such as a transposed, mirrored or scaled matrix, and what
///   to do.
geometry::Pose rigid_pose(const nlohmann::json& matrix, const std::string& expected);

/// The rotation nearest to a matrix. @throws DataError as rigid_pose.
geometry::Matrix3 rotation_near(const geometry::Matrix3& matrix, const std::string& expected);

}  // namespace jade::data
