// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "jade/world/vec.h"

namespace jade::world {

/// x(t) = origin + t · direction. Camera rays have a direction whose depth component is 1, so t is
/// the depth of the point.
struct Ray {
  Vec3 origin, direction;
};

/// Intersection with a surface: ray parameter and surface coordinates in [0,1].
struct Hit {
  float t;
  int primitive = -1;
  float u = 0, v = 0;
};

enum class Shape : uint8_t {
  kQuad,       ///< parallelogram a + u·b + v·c
  kDisc,       ///< ellipse inscribed in that parallelogram
  kTube,       ///< open tapered cylinder from a (radius r0) to b (radius r1)
  kEllipsoid,  ///< centre a, axes b and c and their normal, radii in `radii`
};

/// One surface. Create it with the make_* functions, which fill the derived fields.
struct Primitive {
  Shape shape;
  int material = 0;
  Vec3 a, b, c;
  float r0 = 0, r1 = 0;
  Vec3 radii;
  float repeat_u = 1, repeat_v = 1;  ///< texture repeats over the surface
  float texture_width = 1;           ///< world length of one texture width
  bool cutout = false;               ///< transparent where the texture is

  // Derived.
  Vec3 normal;          // quad: unit; tube: unit axis; ellipsoid: third axis
  Vec3 dual_u, dual_v;  // quad: dot with (x - a) gives u and v; tube: unit vectors across the axis
  float height = 0;     // tube: length
};

Primitive make_quad(Vec3 origin, Vec3 edge_u, Vec3 edge_v, int material);
Primitive make_disc(Vec3 center, Vec3 half_u, Vec3 half_v, int material);
Primitive make_tube(Vec3 from, Vec3 to, float radius_from, float radius_to, int material);
/// @param axis_x, axis_y  unit and perpendicular
Primitive make_ellipsoid(Vec3 center, Vec3 axis_x, Vec3 axis_y, Vec3 radii, int material);

/// Finds the nearest intersection with kNear < t < hit.t; if there is one, replaces `hit` and
/// returns true.

bool intersect(const Primitive& primitive, const Ray& ray, Hit& hit);

/// Point and outward unit normal at surface coordinates (u,v).
struct SurfacePoint {
  Vec3 position, normal;
};
SurfacePoint surface_point(const Primitive& primitive, float u, float v);

/// Axis-aligned bounds.
struct Bounds {
  Vec3 low{1e30f, 1e30f, 1e30f}, high{-1e30f, -1e30f, -1e30f};
  void add(Vec3 p);
  void add(const Bounds& other);
};
Bounds bounds_of(const Primitive& primitive);

constexpr float kNear = 1e-3f;  ///< nearer surfaces are invisible

}  // namespace jade::world
