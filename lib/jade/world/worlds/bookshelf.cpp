// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "jade/world/worlds.h"
#include "jade/world/worlds/furnish.h"

namespace jade::world::worlds {
namespace {

void vase(WorldBuilder& s, Vec3 base, float size) {
  const int glaze =
      s.material(paints::marble(paints::color(s.draw()), {0.9f, 0.88f, 0.8f}, s.noise_seed()));
  s.tube(base, base + Vec3{0, 0.2f * size, 0}, 0.14f * size, 0.27f * size, glaze);
  s.tube(base + Vec3{0, 0.2f * size, 0}, base + Vec3{0, 0.5f * size, 0}, 0.27f * size, 0.25f * size,
         glaze);
  s.tube(base + Vec3{0, 0.5f * size, 0}, base + Vec3{0, 0.75f * size, 0}, 0.25f * size,
         0.09f * size, glaze);
  s.tube(base + Vec3{0, 0.75f * size, 0}, base + Vec3{0, 0.85f * size, 0}, 0.09f * size,
         0.13f * size, glaze);
  const int bloom = s.cutout(paints::flower(paints::color(s.draw()), {0.9f, 0.75f, 0.2f}, 8));
  const int stem = s.plain({0.25f, 0.4f, 0.16f});
  for (int i = 0; i < 4; ++i) {
    const float a = 1.7f * static_cast<float>(i);
    const Vec3 from = base + Vec3{0, 0.8f * size, 0};
    const Vec3 tip =
        from + Vec3{0.25f * size * std::cos(a), (0.45f + 0.08f * static_cast<float>(i)) * size,
                    0.12f * size * std::sin(a)};
    s.cable({from, (from + tip) * 0.5f + Vec3{0.04f, 0, 0}, tip}, 0.012f * size, stem);
    s.quad(tip + Vec3{-0.16f, 0.16f, 0.03f} * size, Vec3{0.32f, 0, 0.05f} * size,
           Vec3{0, -0.32f, 0.06f} * size, bloom);
  }
}

void globe(WorldBuilder& s, Vec3 base) {
  const int brass = s.material(paints::metal({0.75f, 0.58f, 0.25f}, s.noise_seed()));
  s.tube(base, base + Vec3{0, 0.02f, 0}, 0.07f, 0.06f, brass, brass);
  s.tube(base, base + Vec3{0, 0.07f, 0}, 0.012f, 0.012f, brass);
  s.ball(base + Vec3{0, 0.17f, 0}, 0.11f, s.material(paints::map_sheet(s.noise_seed())));
}

void case_frame(WorldBuilder& s) {
  const int oak =
      s.material(paints::wood({0.62f, 0.44f, 0.27f}, {0.38f, 0.25f, 0.14f}, 8, s.noise_seed()));
  s.quad({-1.5f, 2.6f, -0.32f}, {3, 0, 0}, {0, -2.6f, 0},
         s.material(paints::planks({0.5f, 0.36f, 0.22f}, {0.36f, 0.24f, 0.14f}, 6, s.noise_seed())),
         1.0f);
  for (int row = 0; row < 6; ++row)
    s.box({0, 0.2f + 0.4f * static_cast<float>(row), -0.15f}, {2.7f, 0.03f, 0.34f}, oak);
  for (float x : {-1.35f, -0.45f, 0.45f, 1.35f}) s.box({x, 0, -0.15f}, {0.03f, 2.6f, 0.34f}, oak);
}

void fill(WorldBuilder& s) {
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 3; ++column) {
      const Vec3 left{-1.33f + 0.9f * static_cast<float>(column),
                      0.23f + 0.4f * static_cast<float>(row), 0.0f};
      switch ((row * 3 + column * 2 + row / 2) % 6) {
        case 1:
          book_row(s, left, 0.45f, 0.34f, 0.24f);
          plant(s, left + Vec3{0.66f, 0, -0.1f}, 0.3f);
          break;
        case 3:
          book_pile(s, left + Vec3{0.2f, 0, -0.12f}, 4);
          globe(s, left + Vec3{0.6f, 0, -0.1f});
          break;
        case 5:
          vase(s, left + Vec3{0.14f, 0, -0.1f}, 0.24f);
          book_row(s, left + Vec3{0.3f, 0, 0}, 0.55f, 0.33f, 0.22f);
          break;
        default:
          book_row(s, left, 0.86f, 0.35f, 0.25f);
      }
    }
  }
}

void in_front(WorldBuilder& s) {
  // A ladder leans on the case, and a chair's back occludes it.
  const int pine =
      s.material(paints::wood({0.85f, 0.7f, 0.48f}, {0.62f, 0.44f, 0.26f}, 4, s.noise_seed()));
  for (float x : {0.52f, 0.86f}) s.tube({x, 0, 0.75f}, {x, 2.4f, 0.08f}, 0.022f, 0.022f, pine);
  for (int i = 0; i < 7; ++i) {
    const float t = 0.12f + 0.13f * static_cast<float>(i);
    s.tube({0.52f, 2.4f * t, 0.75f - 0.67f * t}, {0.86f, 2.4f * t, 0.75f - 0.67f * t}, 0.014f,
           0.014f, pine);
  }
  s.box({-0.75f, 0, 0.62f}, {0.5f, 0.86f, 0.4f},
        s.material(paints::fabric({0.24f, 0.4f, 0.46f}, {0.14f, 0.22f, 0.3f}, {0.85f, 0.75f, 0.5f},
                                  3, s.noise_seed())),
        15, 0.4f);
  book_pile(s, {-0.75f, 0.86f, 0.62f}, 4);
  mug(s, {-0.72f, 1.05f, 0.6f}, 0.1f,
      s.material(paints::stripes({0.92f, 0.9f, 0.85f}, {0.7f, 0.25f, 0.2f}, 6, false)));
  s.quad({-3, 0, -0.35f}, {6, 0, 0}, {0, 0, 4},
         s.material(paints::carpet({0.55f, 0.16f, 0.14f}, {0.2f, 0.22f, 0.36f},
                                   {0.85f, 0.72f, 0.45f}, s.noise_seed())),
         2.0f);
}

}  // namespace

World bookshelf(uint64_t seed) {
  WorldBuilder s("bookshelf", seed);
  case_frame(s);
  fill(s);
  in_front(s);
  s.lamp({-0.8f, 2.4f, 1.8f}, {1.9f, 1.75f, 1.5f}, 0.25f);
  s.lamp({1.2f, 1.9f, 1.2f}, {0.5f, 0.42f, 0.3f}, 0.1f);
  s.world().ambient_up = {0.36f, 0.36f, 0.38f};
  s.world().background = {0.3f, 0.28f, 0.25f};
  s.world().rig = {{0, 1.35f, 2.25f}, {0, 1.25f, 0}, {0.5f, 0.3f, 0.3f}, {0.3f, 0.2f, 0.1f}};
  return s.finish();
}

}  // namespace jade::world::worlds
