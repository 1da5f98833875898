// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "jade/world/worlds.h"
#include "jade/world/worlds/furnish.h"

namespace jade::world::worlds {
namespace {

void room(WorldBuilder& s) {
  const int wall = s.material(paints::concrete(s.noise_seed()));
  s.quad({-3, 2.8f, -0.8f}, {6, 0, 0}, {0, -2.8f, 0}, wall, 1.6f);
  s.quad({-3, 0, -0.8f}, {6, 0, 0}, {0, 0, 4}, s.material(paints::concrete(s.noise_seed())), 1.5f);
  const int pegs = s.material(paints::pegboard({0.72f, 0.62f, 0.44f}, 16));
  s.box({0, 1.08f, -0.76f}, {2.4f, 0.95f, 0.03f}, {pegs, s.plain({0.4f, 0.3f, 0.2f}), pegs}, 0,
        0.6f);
}

void hammer(WorldBuilder& s, Vec3 at, int handle, int steel) {
  s.tube(at, at + Vec3{0, 0.3f, 0}, 0.017f, 0.013f, handle, handle);
  s.tube(at + Vec3{-0.07f, 0.3f, 0}, at + Vec3{0.07f, 0.3f, 0}, 0.022f, 0.028f, steel, steel);
}

void wrench(WorldBuilder& s, Vec3 at, float length, int steel) {
  s.box(at + Vec3{0, 0.02f, 0}, {0.026f, length, 0.012f}, steel);
  for (float y : {0.0f, length}) {
    s.tube(at + Vec3{0, y + 0.02f, -0.008f}, at + Vec3{0, y + 0.02f, 0.012f}, 0.034f, 0.034f, steel,
           steel);
    s.disc(at + Vec3{0, y + 0.02f, 0.014f}, {0.017f, 0, 0}, {0, 0.017f, 0},
           s.plain({0.1f, 0.1f, 0.1f}));
  }
}

void saw(WorldBuilder& s, Vec3 at) {
  Canvas handle = paints::wood({0.7f, 0.42f, 0.2f}, {0.4f, 0.2f, 0.1f}, 6, s.noise_seed());
  handle.cut(
      [](float u, float v) { return std::hypot((u - 0.5f) * 2, (v - 0.5f) * 2.2f) > 0.45f; });
  s.quad(at + Vec3{0, 0.16f, 0.01f}, {0.16f, 0, 0}, {0, -0.16f, 0}, s.cutout(handle));
  Canvas blade = paints::metal({0.8f, 0.81f, 0.82f}, s.noise_seed());
  blade.text("SHARP 45", 0.2f, 0.3f, 0.22f, {0.3f, 0.3f, 0.35f});
  blade.cut([](float u, float v) {
    const float tooth = std::abs(u * 30 - std::floor(u * 30) - 0.5f);
    return v > 0.25f * u && v < 1 - 0.12f * tooth;
  });
  s.quad(at + Vec3{0.14f, 0.14f, 0.005f}, {0.48f, 0, 0}, {0, -0.13f, 0}, s.cutout(blade));
}

void tools(WorldBuilder& s) {
  const int steel = s.material(paints::metal({0.72f, 0.73f, 0.75f}, s.noise_seed()));
  const int ash =
      s.material(paints::wood({0.8f, 0.6f, 0.36f}, {0.5f, 0.32f, 0.16f}, 5, s.noise_seed()));
  hammer(s, {-1.0f, 1.5f, -0.7f}, ash, steel);
  hammer(s, {-0.8f, 1.55f, -0.7f}, s.plain({0.75f, 0.2f, 0.12f}), steel);
  for (int i = 0; i < 6; ++i) {
    wrench(s, {-0.6f + 0.09f * static_cast<float>(i), 1.62f, -0.71f},
           0.26f - 0.028f * static_cast<float>(i), steel);
  }
  saw(s, {0.1f, 1.74f, -0.71f});
  for (int i = 0; i < 7; ++i) {  // screwdrivers
    const float x = 0.12f + 0.085f * static_cast<float>(i), y = 1.5f;
    const int grip = s.plain(paints::color(s.draw()));
    s.tube({x, y, -0.7f}, {x, y + 0.11f, -0.7f}, 0.02f, 0.015f, grip, grip);
    s.tube({x, y - 0.13f - 0.01f * static_cast<float>(i % 3), -0.7f}, {x, y, -0.7f}, 0.006f, 0.006f,
           steel);
  }
  const int red = s.plain({0.7f, 0.16f, 0.12f});
  std::vector<Vec3> coil;  // a hank of cable
  for (int i = 0; i < 22; ++i) {
    const float a = 0.9f * static_cast<float>(i), r = 0.12f + 0.002f * static_cast<float>(i);
    coil.push_back(
        {0.96f + r * std::sin(a), 1.62f + r * std::cos(a), -0.7f + 0.004f * static_cast<float>(i)});
  }
  s.cable(coil, 0.008f, red);
}

void vise(WorldBuilder& s, Vec3 base) {
  const int iron = s.material(paints::metal({0.22f, 0.34f, 0.5f}, s.noise_seed()));
  const int steel = s.material(paints::metal({0.7f, 0.7f, 0.7f}, s.noise_seed()));
  s.box(base, {0.2f, 0.06f, 0.16f}, iron);
  s.box(base + Vec3{-0.05f, 0.06f, 0}, {0.07f, 0.14f, 0.16f}, iron);
  s.box(base + Vec3{0.07f, 0.06f, 0}, {0.05f, 0.14f, 0.16f}, iron);
  s.tube(base + Vec3{0.08f, 0.1f, 0}, base + Vec3{0.24f, 0.1f, 0}, 0.02f, 0.02f, steel, steel);
  s.tube(base + Vec3{0.22f, 0.0f, 0.03f}, base + Vec3{0.22f, 0.2f, -0.03f}, 0.008f, 0.008f, steel);
  s.ball(base + Vec3{0.22f, 0.2f, -0.03f}, 0.014f, steel);
}

void drawers(WorldBuilder& s, Vec3 corner) {
  const int frame = s.plain({0.2f, 0.24f, 0.28f});
  s.box(corner + Vec3{0.26f, 0, -0.09f}, {0.54f, 0.42f, 0.18f}, frame);
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      Canvas front(96, 64, paints::color(s.draw()));
      front.rect(0.15f, 0.12f, 0.85f, 0.45f, {0.92f, 0.91f, 0.85f});
      front.text(paints::word(s.draw()).substr(0, 5), 0.2f, 0.18f, 0.2f, {0.1f, 0.1f, 0.1f});
      front.rect(0.35f, 0.65f, 0.65f, 0.78f, {0.15f, 0.15f, 0.16f});
      const Vec3 at = corner + Vec3{0.02f + 0.125f * static_cast<float>(column),
                                    0.11f + 0.1f * static_cast<float>(row), 0.004f};
      s.quad(at, {0.115f, 0, 0}, {0, -0.09f, 0}, s.material(front));
    }
  }
}

void bench(WorldBuilder& s) {
  const int top =
      s.material(paints::planks({0.76f, 0.58f, 0.36f}, {0.48f, 0.32f, 0.18f}, 4, s.noise_seed()));
  s.box({0, 0.8f, -0.2f}, {2.6f, 0.07f, 1.0f}, top);
  vise(s, {-0.85f, 0.87f, 0.05f});
  drawers(s, {0.58f, 0.87f, -0.5f});
  const int chip = s.material(paints::circuit(s.noise_seed())),
            iron = s.material(paints::rust(s.noise_seed()));
  s.box({0.25f, 0.87f, 0.08f}, {0.38f, 0.015f, 0.28f}, chip, -12);
  s.cable({{0.3f, 0.89f, 0.05f}, {0.45f, 0.98f, 0.1f}, {0.6f, 0.9f, 0.05f}, {0.75f, 0.88f, 0.12f}},
          0.006f, s.plain({0.85f, 0.7f, 0.1f}));
  s.cable(
      {{0.2f, 0.89f, 0.0f}, {0.15f, 1.0f, -0.1f}, {0.35f, 0.93f, -0.25f}, {0.55f, 0.9f, -0.35f}},
      0.006f, s.plain({0.15f, 0.3f, 0.65f}));
  for (int i = 0; i < 5; ++i) {  // a bundle of pipes
    const float x = -0.4f + 0.05f * static_cast<float>(i);
    s.tube({x, 0.9f + 0.02f * static_cast<float>(i % 2), 0.25f},
           {x + 0.12f, 0.9f + 0.02f * static_cast<float>(i % 2), -0.5f}, 0.022f, 0.022f,
           i % 2 ? iron : s.material(paints::metal({0.75f, 0.5f, 0.3f}, s.noise_seed())));
  }
  tin(s, {-0.55f, 0.87f, 0.0f}, 0.07f, 0.17f);
  tin(s, {-1.08f, 0.87f, -0.3f}, 0.09f, 0.22f);
  tin(s, {0.5f, 0.87f, -0.1f}, 0.05f, 0.13f);
  const int plaid = s.material(paints::fabric({0.7f, 0.25f, 0.2f}, {0.25f, 0.1f, 0.12f},
                                              {0.9f, 0.8f, 0.4f}, 4, s.noise_seed()));
  s.box({0.85f, 0.87f, 0.12f}, {0.3f, 0.03f, 0.24f}, plaid, 20);
  parcel(s, {-0.15f, 0.87f, -0.45f}, {0.34f, 0.28f, 0.24f}, -10);
  s.box({0.0f, 0.87f, 0.22f}, {0.4f, 0.004f, 0.04f}, s.material(paints::ruler()), 7);
  // A wire basket in front, seen through.
  const int mesh = s.cutout(paints::wire_mesh({0.75f, 0.75f, 0.78f}, 9, 0.14f));
  s.box({-0.2f, 0.87f, 0.12f}, {0.22f, 0.12f, 0.14f}, mesh, 15);
  s.ball({-0.2f, 0.91f, 0.12f}, 0.045f, s.plain({0.85f, 0.45f, 0.12f}));
}

}  // namespace

World workshop(uint64_t seed) {
  WorldBuilder s("workshop", seed);
  room(s);
  tools(s);
  bench(s);
  s.quad({-1.7f, 1.9f, -0.78f}, {0.44f, 0, 0}, {0, -0.6f, 0},
         s.material(paints::poster("SAFETY", s.noise_seed())));
  const int cord = s.plain({0.08f, 0.08f, 0.08f});
  s.tube({0.3f, 2.6f, 0.0f}, {0.3f, 2.05f, 0.0f}, 0.008f, 0.008f, cord);
  s.tube({0.3f, 2.05f, 0.0f}, {0.3f, 1.95f, 0.0f}, 0.04f, 0.16f, s.plain({0.2f, 0.42f, 0.35f}));
  s.ball({0.3f, 1.97f, 0.0f}, 0.04f, s.material(Canvas(4, 4, {1, 0.92f, 0.75f}), 1.5f));
  s.lamp({0.3f, 1.9f, 0.05f}, {0.55f, 0.48f, 0.36f}, 0.08f);
  s.lamp({-0.9f, 2.6f, 1.6f}, {1.3f, 1.35f, 1.45f}, 0.25f);
  s.world().ambient_up = {0.34f, 0.36f, 0.4f};
  s.world().rig = {{0, 1.48f, 1.95f}, {0, 1.28f, -0.4f}, {0.5f, 0.25f, 0.25f}, {0.3f, 0.18f, 0.1f}};
  return s.finish();
}

}  // namespace jade::world::worlds
