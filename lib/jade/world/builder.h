// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/world/noise.h"
#include "jade/world/world.h"

namespace jade::world {

/// Materials of a box: the face towards +z (the viewer), the other side faces, the top.
struct BoxSkin {
  BoxSkin(int all) : front(all), side(all), top(all) {}  // NOLINT: one material is a whole skin
  BoxSkin(int front_, int side_, int top_) : front(front_), side(side_), top(top_) {}
  int front, side, top;
};

/// Builds a scene from a few solid shapes. World: x right, y up, z towards the viewer.
class WorldBuilder {
 public:
  WorldBuilder(std::string name, uint64_t seed);

  Draw& draw() { return draw_; }
  uint32_t noise_seed() { return static_cast<uint32_t>(draw_.bits()); }
  World& world() { return world_; }

  int material(const Canvas& canvas, float emission = 0);
  /// Transparent where the canvas was cut.
  int cutout(const Canvas& canvas);
  int plain(Rgb color);

  /// A rectangle; the texture's top left corner is at `top_left`, and it repeats every `tile` world
  /// units (0: stretched once over the whole).
  void quad(Vec3 top_left, Vec3 right, Vec3 down, int material, float tile = 0);
  void disc(Vec3 center, Vec3 half_right, Vec3 half_down, int material);
  /// A box with the middle of its bottom at `base`, rotated by `yaw` degrees about the vertical.
  void box(Vec3 base, Vec3 size, BoxSkin skin, float yaw = 0, float tile = 0);
  /// A tapered cylinder with both ends closed by `cap` (-1: open).
  void tube(Vec3 from, Vec3 to, float radius_from, float radius_to, int side, int cap = -1);
  void ball(Vec3 center, float radius, int material) {
    ellipsoid(center, {radius, radius, radius}, material);
  }
  void ellipsoid(Vec3 center, Vec3 radii, int material, float yaw = 0, float tilt = 0);
  /// A smooth cable through the knots.
  void cable(const std::vector<Vec3>& knots, float radius, int material);
  void lamp(Vec3 position, Rgb color, float radius = 0.12f);
  void sun(Vec3 towards, Rgb color, float spread = 0.03f);

  /// The finished scene with baked light.
  World finish();

 private:
  void add(Primitive primitive, float tile);

  World world_;
  Draw draw_;
  uint64_t seed_;
};

}  // namespace jade::world
