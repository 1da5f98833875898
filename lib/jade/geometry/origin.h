// SPDX-License-Identifier: Apache-2.0
// Scenes in map coordinates are thousands of kilometres from their origin, where float32 has steps
// of half a metre. Loaders move them to an origin nearby.
#pragma once

#include <string>

#include "jade/geometry/pose.h"

namespace jade::geometry {

/// The origin to which a scene is moved: zero if float32 resolves the scene well enough, else a
/// round point near its middle.
/// @param middle  of the scene
/// @param size    of the scene, in the same unit: a distance that must be resolved well; 0 if
///   unknown
Vector3 scene_origin(const Vector3& middle, double size);

/// The camera in a world with its origin at `origin` of this one: t + R origin.
Pose with_origin(const Pose& camera_from_world, const Vector3& origin);

bool is_zero(const Vector3& vector);

/// "471234.5 5431987 312", with all significant digits.
std::string text_of(const Vector3& vector);

}  // namespace jade::geometry
