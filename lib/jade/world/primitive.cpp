// SPDX-License-Identifier: Apache-2.0
#include "jade/world/primitive.h"

#include <algorithm>
#include <cmath>

namespace jade::world {
namespace {

constexpr float kPi = 3.14159265358979f;

bool meet_plane(const Primitive& p, const Ray& ray, Hit& hit) {
  const float slope = dot(p.normal, ray.direction);
  const Vec3 offset = p.a - ray.origin;
  const float t = dot(p.normal, offset) / slope;
  if (!(t > kNear && t < hit.t)) {
    return false;
  }
  const Vec3 x = ray.direction * t - offset;
  const float u = dot(x, p.dual_u), v = dot(x, p.dual_v);
  if (u < 0 || u > 1 || v < 0 || v > 1) {
    return false;
  }
  if (p.shape == Shape::kDisc && (u - 0.5f) * (u - 0.5f) + (v - 0.5f) * (v - 0.5f) > 0.25f) {
    return false;
  }
  hit.t = t, hit.u = u, hit.v = v;
  return true;
}

// |x⊥|² = (r0 + k z)² with z along the axis, x = origin + t·direction − a.
bool meet_tube(const Primitive& p, const Ray& ray, Hit& hit) {
  const Vec3 x = ray.origin - p.a;
  const float dz = dot(ray.direction, p.normal), xz = dot(x, p.normal);
  const float k = (p.r1 - p.r0) / p.height, r = p.r0 + k * xz;
  const float a = dot(ray.direction, ray.direction) - dz * dz * (1 + k * k);
  const float b = dot(x, ray.direction) - xz * dz - k * dz * r;
  const float c = dot(x, x) - xz * xz - r * r;
  const float root = b * b - a * c;
  if (root < 0 || a == 0) {
    return false;
  }
  const float s = std::sqrt(root);
  float near = (-b - s) / a, far = (-b + s) / a;
  if (near > far) {
    std::swap(near, far);
  }
  for (float t : {near, far}) {
    const float z = xz + t * dz;
    if (t > kNear && t < hit.t && z >= 0 && z <= p.height) {
      const Vec3 q = x + ray.direction * t;
      hit.t = t, hit.v = z / p.height;
      hit.u = std::atan2(dot(q, p.dual_v), dot(q, p.dual_u)) * (0.5f / kPi) + 0.5f;
      return true;
    }
  }
  return false;
}

Vec3 to_unit_ball(const Primitive& p, Vec3 v) {
  return {dot(v, p.b) / p.radii.x, dot(v, p.c) / p.radii.y, dot(v, p.normal) / p.radii.z};
}

bool meet_ellipsoid(const Primitive& p, const Ray& ray, Hit& hit) {
  const Vec3 x = to_unit_ball(p, ray.origin - p.a), d = to_unit_ball(p, ray.direction);
  const float a = dot(d, d), b = dot(x, d), c = dot(x, x) - 1;
  const float root = b * b - a * c;
  if (root < 0) {
    return false;
  }
  const float s = std::sqrt(root);
  for (float t : {(-b - s) / a, (-b + s) / a}) {
    if (t > kNear && t < hit.t) {
      const Vec3 q = x + d * t;
      hit.t = t;
      hit.u = std::atan2(q.z, q.x) * (0.5f / kPi) + 0.5f;
      hit.v = std::acos(std::clamp(q.y, -1.0f, 1.0f)) / kPi;
      return true;
    }
  }
  return false;
}

}  // namespace

Primitive make_quad(Vec3 origin, Vec3 edge_u, Vec3 edge_v, int material) {
  Primitive p;
  p.shape = Shape::kQuad, p.material = material;
  p.a = origin, p.b = edge_u, p.c = edge_v;
  const Vec3 n = cross(edge_v, edge_u);
  p.normal = normalized(n);
  p.dual_u = cross(n, edge_v) * (1 / dot(n, n));
  p.dual_v = cross(edge_u, n) * (1 / dot(n, n));
  p.texture_width = length(edge_u);
  return p;
}

Primitive make_disc(Vec3 center, Vec3 half_u, Vec3 half_v, int material) {
  Primitive p = make_quad(center - half_u - half_v, half_u * 2, half_v * 2, material);
  p.shape = Shape::kDisc;
  return p;
}

Primitive make_tube(Vec3 from, Vec3 to, float radius_from, float radius_to, int material) {
  Primitive p;
  p.shape = Shape::kTube, p.material = material;
  p.a = from, p.b = to, p.r0 = radius_from, p.r1 = radius_to;
  p.height = length(to - from);
  p.normal = normalized(to - from);
  p.dual_u = perpendicular(p.normal);
  p.dual_v = cross(p.normal, p.dual_u);
  p.texture_width = 2 * kPi * std::max(radius_from, radius_to);
  return p;
}

Primitive make_ellipsoid(Vec3 center, Vec3 axis_x, Vec3 axis_y, Vec3 radii, int material) {
  Primitive p;
  p.shape = Shape::kEllipsoid, p.material = material;
  p.a = center, p.b = axis_x, p.c = axis_y, p.normal = cross(axis_x, axis_y), p.radii = radii;
  p.texture_width = 2 * kPi * std::max(radii.x, radii.z);
  return p;
}

bool intersect(const Primitive& primitive, const Ray& ray, Hit& hit) {
  switch (primitive.shape) {
    case Shape::kTube:
      return meet_tube(primitive, ray, hit);
    case Shape::kEllipsoid:
      return meet_ellipsoid(primitive, ray, hit);
    default:
      return meet_plane(primitive, ray, hit);
  }
}

SurfacePoint surface_point(const Primitive& p, float u, float v) {
  const float angle = (u - 0.5f) * 2 * kPi;
  if (p.shape == Shape::kTube) {
    const Vec3 out = p.dual_u * std::cos(angle) + p.dual_v * std::sin(angle);
    const float slope = (p.r1 - p.r0) / p.height;
    return {p.a + p.normal * (v * p.height) + out * (p.r0 + (p.r1 - p.r0) * v),
            normalized(out - p.normal * slope)};
  }
  if (p.shape == Shape::kEllipsoid) {
    const float polar = v * kPi;
    const Vec3 q{std::cos(angle) * std::sin(polar), std::cos(polar),
                 std::sin(angle) * std::sin(polar)};
    const Vec3 position =
        p.b * (q.x * p.radii.x) + p.c * (q.y * p.radii.y) + p.normal * (q.z * p.radii.z);
    const Vec3 n = p.b * (q.x / p.radii.x) + p.c * (q.y / p.radii.y) + p.normal * (q.z / p.radii.z);
    return {p.a + position, normalized(n)};
  }
  return {p.a + p.b * u + p.c * v, p.normal};
}

void Bounds::add(Vec3 p) {
  low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
  high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
}

void Bounds::add(const Bounds& other) {
  add(other.low);
  add(other.high);
}

Bounds bounds_of(const Primitive& p) {
  Bounds bounds;
  if (p.shape == Shape::kTube) {
    const auto across = [&](float r) {
      return Vec3{r * std::sqrt(std::max(0.0f, 1 - p.normal.x * p.normal.x)),
                  r * std::sqrt(std::max(0.0f, 1 - p.normal.y * p.normal.y)),
                  r * std::sqrt(std::max(0.0f, 1 - p.normal.z * p.normal.z))};
    };
    bounds.add(p.a - across(p.r0)), bounds.add(p.a + across(p.r0));
    bounds.add(p.b - across(p.r1)), bounds.add(p.b + across(p.r1));
  } else if (p.shape == Shape::kEllipsoid) {
    const auto reach = [&](float x, float y, float z) {
      return std::sqrt(x * x * p.radii.x * p.radii.x + y * y * p.radii.y * p.radii.y +
                       z * z * p.radii.z * p.radii.z);
    };
    const Vec3 r{reach(p.b.x, p.c.x, p.normal.x), reach(p.b.y, p.c.y, p.normal.y),
                 reach(p.b.z, p.c.z, p.normal.z)};
    bounds.add(p.a - r), bounds.add(p.a + r);
  } else {
    for (int corner = 0; corner < 4; ++corner) {
      bounds.add(p.a + p.b * static_cast<float>(corner & 1) +
                 p.c * static_cast<float>(corner >> 1));
    }
  }
  const Vec3 margin{1e-4f, 1e-4f, 1e-4f};
  return {bounds.low - margin, bounds.high + margin};
}

}  // namespace jade::world
