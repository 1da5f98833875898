// SPDX-License-Identifier: Apache-2.0
// Objects that several scenes contain.
#pragma once

#include "jade/world/builder.h"
#include "jade/world/paints.h"

namespace jade::world::worlds {

/// Books upright in a row, from `left` (bottom, front edges) to the right over `width`.
void book_row(WorldBuilder& s, Vec3 left, float width, float height, float depth);
/// A pile of books.
void book_pile(WorldBuilder& s, Vec3 base, int count);
void mug(WorldBuilder& s, Vec3 base, float size, int material);
/// A pot with leaves (flat, see-through) around its top.
void plant(WorldBuilder& s, Vec3 base, float size);
/// A tin or jar with a printed label around it.
void tin(WorldBuilder& s, Vec3 base, float radius, float height);
/// A parcel with a label in front.
void parcel(WorldBuilder& s, Vec3 base, Vec3 size, float yaw);
/// A lamp on a jointed arm that shines.
void desk_lamp(WorldBuilder& s, Vec3 base);
void pencils(WorldBuilder& s, Vec3 base);

}  // namespace jade::world::worlds
