// SPDX-License-Identifier: Apache-2.0
// Things that stand in more than one scene.
#pragma once

#include "jade/simulate/paints.h"
#include "jade/simulate/scene_builder.h"

namespace jade::simulate::scenes {

/// Books upright in a row, from `left` (bottom, front edges) to the right over `width`.
void book_row(SceneBuilder& s, Vec3 left, float width, float height, float depth);
/// Books lying on each other.
void book_pile(SceneBuilder& s, Vec3 base, int count);
void mug(SceneBuilder& s, Vec3 base, float size, int material);
/// A pot with leaves (flat, see-through) around its top.
void plant(SceneBuilder& s, Vec3 base, float size);
/// A tin or jar with a printed label around it.
void tin(SceneBuilder& s, Vec3 base, float radius, float height);
/// A parcel with a label in front.
void parcel(SceneBuilder& s, Vec3 base, Vec3 size, float yaw);
/// A lamp on a jointed arm that shines.
void desk_lamp(SceneBuilder& s, Vec3 base);
void pencils(SceneBuilder& s, Vec3 base);

}  // namespace jade::simulate::scenes
