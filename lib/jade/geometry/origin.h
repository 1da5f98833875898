// SPDX-License-Identifier: Apache-2.0
// Scenes in map coordinates lie thousands of kilometres from their origin, where float32 has steps
// of half a metre. They are moved to an origin of their own.
#pragma once

#include <string>

#include "jade/geometry/pose.h"

namespace jade::geometry {

/// The origin to which a scene is moved: zero where float32 resolves the scene well enough, else a
/// round point near its middle.
/// @param middle  of the scene
/// @param size    of the scene, in the same unit: distances in it that are to be resolved well; 0
///   where nobody knows
Vector3 scene_origin(const Vector3& middle, double size);

/// Camera in a world whose origin lies at `origin` of this one: t + R origin.
Pose with_origin(const Pose& camera_from_world, const Vector3& origin);

bool is_zero(const Vector3& vector);

/// "471234.5 5431987 312", with all digits that count.
std::string text_of(const Vector3& vector);

}  // namespace jade::geometry
