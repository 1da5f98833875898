// SPDX-License-Identifier: Apache-2.0
#include "jade/world/builder.h"

#include <cmath>
#include <utility>

namespace jade::world {
namespace {

constexpr float kDegree = 3.14159265358979f / 180;

}  // namespace

WorldBuilder::WorldBuilder(std::string name, uint64_t seed) : draw_(seed, 1), seed_(seed) {
  world_.name = std::move(name);
}

int WorldBuilder::material(const Canvas& canvas, float emission) {
  world_.materials.push_back({Texture(canvas), false, emission});
  return static_cast<int>(world_.materials.size()) - 1;
}

int WorldBuilder::cutout(const Canvas& canvas) {
  const int id = material(canvas);
  world_.materials.back().cutout = true;
  return id;
}

int WorldBuilder::plain(Rgb color) { return material(Canvas(4, 4, color)); }

void WorldBuilder::add(Primitive p, float tile) {
  if (tile > 0) {
    p.repeat_u = length(p.b) / tile;
    p.repeat_v = length(p.c) / tile;
  }
  p.cutout = world_.materials[static_cast<size_t>(p.material)].cutout;
  world_.primitives.push_back(p);
}

void WorldBuilder::quad(Vec3 top_left, Vec3 right, Vec3 down, int material, float tile) {
  add(make_quad(top_left, right, down, material), tile);
}

void WorldBuilder::disc(Vec3 center, Vec3 half_right, Vec3 half_down, int material) {
  add(make_disc(center, half_right, half_down, material), 0);
}

void WorldBuilder::box(Vec3 base, Vec3 size, BoxSkin skin, float yaw, float tile) {
  const float c = std::cos(yaw * kDegree), s = std::sin(yaw * kDegree);
  const Vec3 x{c * size.x, 0, -s * size.x}, y{0, size.y, 0}, z{s * size.z, 0, c * size.z};
  const Vec3 corner = base - x * 0.5f - z * 0.5f;  // bottom, left, back
  quad(corner + z + y, x, -y, skin.front, tile);
  quad(corner + x + y, -x, -y, skin.side, tile);
  quad(corner + y, z, -y, skin.side, tile);
  quad(corner + x + z + y, -z, -y, skin.side, tile);
  quad(corner + y, x, z, skin.top, tile);
  quad(corner, x, z, skin.side, tile);
}

void WorldBuilder::tube(Vec3 from, Vec3 to, float radius_from, float radius_to, int side, int cap) {
  add(make_tube(from, to, radius_from, radius_to, side), 0);
  if (cap >= 0) {
    const Vec3 axis = normalized(to - from), u = perpendicular(axis), v = cross(axis, u);
    disc(from, u * radius_from, v * radius_from, cap);
    disc(to, u * radius_to, v * radius_to, cap);
  }
}

void WorldBuilder::ellipsoid(Vec3 center, Vec3 radii, int material, float yaw, float tilt) {
  const float c = std::cos(yaw * kDegree), s = std::sin(yaw * kDegree);
  const float ct = std::cos(tilt * kDegree), st = std::sin(tilt * kDegree);
  const Vec3 flat{c, 0, -s};
  const Vec3 axis_x = flat * ct + Vec3{0, st, 0}, axis_y = flat * -st + Vec3{0, ct, 0};
  add(make_ellipsoid(center, axis_x, axis_y, radii, material), 0);
}

void WorldBuilder::cable(const std::vector<Vec3>& knots, float radius, int material) {
  constexpr int kSteps = 7;
  const auto knot = [&](int i) {
    return knots[static_cast<size_t>(std::min(std::max(i, 0), static_cast<int>(knots.size()) - 1))];
  };
  Vec3 last = knots.front();
  for (int i = 0; i + 1 < static_cast<int>(knots.size()); ++i) {
    const Vec3 p0 = knot(i - 1), p1 = knot(i), p2 = knot(i + 1), p3 = knot(i + 2);
    for (int k = 1; k <= kSteps; ++k) {
      const float t = static_cast<float>(k) / kSteps;
      const Vec3 next = (p1 * 2 + (p2 - p0) * t + (p0 * 2 - p1 * 5 + p2 * 4 - p3) * (t * t) +
                         (p1 * 3 - p0 - p2 * 3 + p3) * (t * t * t)) *
                        0.5f;
      add(make_tube(last, next, radius, radius, material), 0);
      ball(next, radius, material);
      last = next;
    }
  }
}

void WorldBuilder::lamp(Vec3 position, Rgb color, float radius) {
  world_.lights.push_back({position, color, radius, false});
}

void WorldBuilder::sun(Vec3 towards, Rgb color, float spread) {
  world_.lights.push_back({normalized(towards), color, spread, true});
}

World WorldBuilder::finish() {
  world_.bvh = Bvh(world_.primitives);
  bake_light(world_, seed_);
  return std::move(world_);
}

}  // namespace jade::world
