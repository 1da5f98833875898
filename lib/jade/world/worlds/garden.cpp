// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "jade/world/worlds.h"
#include "jade/world/worlds/furnish.h"

namespace jade::world::worlds {
namespace {

void ground(WorldBuilder& s) {
  s.quad({-9, 7, -7}, {18, 0, 0}, {0, -7.5f, 0}, s.material(paints::sky(s.noise_seed()), 0.35f));
  s.quad({-9, 0, -7}, {18, 0, 0}, {0, 0, 10}, s.material(paints::grass(s.noise_seed())), 1.3f);
  s.quad({-0.5f, 0.006f, -6}, {1.1f, 0, 0.0f}, {0.3f, 0, 8},
         s.material(paints::cobbles({0.66f, 0.62f, 0.56f}, {0.3f, 0.3f, 0.22f}, 7, s.noise_seed())),
         1.0f);
  s.quad({-9, 2.3f, -6.2f}, {18, 0, 0}, {0, -2.3f, 0},
         s.material(paints::foliage({0.42f, 0.56f, 0.24f}, {0.14f, 0.28f, 0.1f}, s.noise_seed())),
         1.7f);
}

void fence(WorldBuilder& s) {
  const int white =
      s.material(paints::wood({0.88f, 0.86f, 0.8f}, {0.7f, 0.67f, 0.6f}, 4, s.noise_seed()));
  for (int i = 0; i < 26; ++i) {
    const float x = -3.2f + 0.17f * static_cast<float>(i);
    if (x > -0.25f && x < 0.85f) continue;
    s.box({x, 0, -2.2f}, {0.1f, 0.78f + 0.05f * static_cast<float>(i % 2), 0.025f}, white);
  }
  for (float y : {0.22f, 0.6f}) {
    s.box({-1.75f, y, -2.23f}, {3.0f, 0.07f, 0.03f}, white);
    s.box({1.15f, y, -2.23f}, {0.55f, 0.07f, 0.03f}, white);
  }
}

void arch(WorldBuilder& s) {
  const int wood =
      s.material(paints::wood({0.5f, 0.4f, 0.3f}, {0.32f, 0.24f, 0.16f}, 5, s.noise_seed()));
  for (float x : {-0.3f, 0.9f}) s.tube({x, 0, -2.2f}, {x, 1.75f, -2.2f}, 0.035f, 0.03f, wood);
  std::vector<Vec3> bow;
  for (int i = 0; i <= 8; ++i) {
    const float a = 3.14159f * static_cast<float>(i) / 8;
    bow.push_back({0.3f - 0.6f * std::cos(a), 1.75f + 0.35f * std::sin(a), -2.2f});
  }
  s.cable(bow, 0.028f, wood);
  const int leaves =
      s.cutout(paints::leaf({0.5f, 0.66f, 0.28f}, {0.2f, 0.4f, 0.14f}, s.noise_seed()));
  const int rose = s.cutout(paints::flower({0.86f, 0.3f, 0.4f}, {0.95f, 0.8f, 0.4f}, 6));
  Draw& draw = s.draw();
  for (int i = 0; i < 90; ++i) {
    const float t = draw.range(0, 1);
    const Vec3 at = t < 0.3f   ? Vec3{-0.3f, t * 5.8f, -2.2f}
                    : t > 0.7f ? Vec3{0.9f, (1 - t) * 5.8f, -2.2f}
                               : Vec3{0.3f - 0.6f * std::cos((t - 0.3f) * 7.85f),
                                      1.75f + 0.35f * std::sin((t - 0.3f) * 7.85f), -2.2f};
    const float w = draw.range(0.06f, 0.13f), a = draw.range(0, 6.28f);
    const Vec3 right{w * std::cos(a), w * std::sin(a), draw.range(-0.04f, 0.04f)};
    const Vec3 down{-w * std::sin(a), w * std::cos(a), draw.range(-0.04f, 0.04f)};
    const Vec3 shift{draw.range(-0.1f, 0.1f), draw.range(-0.1f, 0.1f), draw.range(-0.08f, 0.12f)};
    s.quad(at + shift - right * 0.5f - down * 0.5f, right, down, i % 4 ? leaves : rose);
  }
}

void flower_bed(WorldBuilder& s, Vec3 corner, float width, float depth, int count) {
  Draw& draw = s.draw();
  const int soil = s.material(paints::gravel(s.noise_seed()));
  s.box(corner + Vec3{width / 2, 0, -depth / 2}, {width, 0.08f, depth},
        {s.material(paints::bricks({0.66f, 0.36f, 0.28f}, {0.7f, 0.66f, 0.6f}, 4, s.noise_seed())),
         soil, soil},
        0, 0.35f);
  const int stem = s.plain({0.28f, 0.46f, 0.18f});
  const int leaves =
      s.cutout(paints::fern({0.4f, 0.6f, 0.25f}, {0.16f, 0.36f, 0.12f}, s.noise_seed()));
  int blooms[5];
  for (int& bloom : blooms)
    bloom = s.cutout(paints::flower(paints::color(draw), {0.9f, 0.75f, 0.2f}, 5 + draw.pick(6)));
  for (int i = 0; i < count; ++i) {
    const Vec3 foot =
        corner + Vec3{draw.range(0.05f, width - 0.05f), 0.08f, -draw.range(0.05f, depth - 0.05f)};
    const Vec3 top =
        foot + Vec3{draw.range(-0.06f, 0.06f), draw.range(0.2f, 0.5f), draw.range(-0.04f, 0.06f)};
    s.tube(foot, top, 0.006f, 0.005f, stem);
    const float r = draw.range(0.05f, 0.09f);
    s.quad(top + Vec3{-r, r, 0.01f}, {2 * r, 0, draw.range(-0.05f, 0.05f)}, {0, -2 * r, 0.06f},
           blooms[draw.pick(5)]);
    s.quad(foot + Vec3{-0.1f, 0.2f, draw.range(-0.05f, 0.05f)}, {0.2f, 0, draw.range(-0.1f, 0.1f)},
           {0, -0.2f, 0}, leaves);
  }
}

void shed(WorldBuilder& s) {
  const int boards =
      s.material(paints::planks({0.42f, 0.52f, 0.55f}, {0.28f, 0.36f, 0.4f}, 9, s.noise_seed()));
  const int roof =
      s.material(paints::bricks({0.55f, 0.26f, 0.2f}, {0.3f, 0.16f, 0.14f}, 10, s.noise_seed()));
  s.box({2.1f, 0, -3.6f}, {2.0f, 1.7f, 1.6f}, boards, -12, 1.3f);
  s.quad({1.0f, 2.35f, -4.2f}, {2.2f, 0, 0.46f}, {-0.1f, -0.75f, 1.2f}, roof, 0.8f);
  Canvas window(128, 128, {0.16f, 0.2f, 0.26f});
  window.rect(0.1f, 0.1f, 0.45f, 0.4f, {0.5f, 0.6f, 0.7f})
      .frame(0, 0, 1, 1, 0.07f, {0.9f, 0.88f, 0.82f});
  window.rect(0.46f, 0, 0.54f, 1, {0.9f, 0.88f, 0.82f})
      .rect(0, 0.46f, 1, 0.54f, {0.9f, 0.88f, 0.82f});
  s.quad({1.45f, 1.4f, -2.9f}, {0.6f, 0, 0.13f}, {0, -0.6f, 0}, s.material(window));
}

void things(WorldBuilder& s) {
  Draw& draw = s.draw();
  plant(s, {-0.85f, 0, -0.4f}, 0.75f);
  plant(s, {1.15f, 0, -1.0f}, 0.85f);
  const int iron = s.plain({0.12f, 0.14f, 0.14f});
  const int slat =
      s.material(paints::wood({0.62f, 0.42f, 0.26f}, {0.4f, 0.25f, 0.14f}, 3, s.noise_seed()));
  for (int i = 0; i < 4; ++i)
    s.box({-1.55f, 0.42f, -1.3f + 0.11f * static_cast<float>(i)}, {1.1f, 0.025f, 0.08f}, slat);
  for (int i = 0; i < 3; ++i)
    s.box({-1.55f, 0.52f + 0.12f * static_cast<float>(i), -1.38f}, {1.1f, 0.08f, 0.025f}, slat);
  for (float x : {-2.05f, -1.05f}) {
    s.tube({x, 0, -1.36f}, {x, 0.88f, -1.4f}, 0.016f, 0.016f, iron);
    s.tube({x, 0, -0.96f}, {x, 0.42f, -0.96f}, 0.016f, 0.016f, iron);
  }
  const int can = s.material(paints::metal({0.35f, 0.55f, 0.5f}, s.noise_seed()));
  s.tube({0.75f, 0, -0.1f}, {0.75f, 0.24f, -0.1f}, 0.11f, 0.1f, can, can);
  s.tube({0.83f, 0.08f, -0.1f}, {1.03f, 0.3f, -0.1f}, 0.02f, 0.014f, can);
  s.cable(
      {{0.7f, 0.24f, -0.1f}, {0.62f, 0.38f, -0.1f}, {0.78f, 0.4f, -0.1f}, {0.83f, 0.22f, -0.1f}},
      0.009f, can);
  for (int i = 0; i < 14; ++i) {
    const Rgb gray = Rgb{0.62f, 0.6f, 0.56f} * draw.range(0.6f, 1.2f);
    s.ellipsoid({-0.62f + draw.range(-0.1f, 0.1f), 0.03f, -1.8f + 0.16f * static_cast<float>(i)},
                {draw.range(0.05f, 0.1f), 0.05f, draw.range(0.05f, 0.09f)},
                s.material(paints::marble(gray, gray * 0.6f, s.noise_seed())), draw.range(0, 90));
  }
  const int bark =
      s.material(paints::planks({0.42f, 0.33f, 0.24f}, {0.2f, 0.15f, 0.1f}, 9, s.noise_seed()));
  s.tube({-2.3f, 0, -2.8f}, {-2.15f, 2.6f, -2.8f}, 0.2f, 0.13f, bark);
  const int crown =
      s.material(paints::foliage({0.5f, 0.62f, 0.26f}, {0.18f, 0.32f, 0.1f}, s.noise_seed()));
  for (int i = 0; i < 9; ++i) {
    const float r = draw.range(0.35f, 0.65f);
    s.ellipsoid({-2.2f + draw.range(-0.8f, 0.8f), 2.5f + draw.range(-0.3f, 0.6f),
                 -2.8f + draw.range(-0.5f, 0.5f)},
                {r, 0.8f * r, r}, crown, draw.range(0, 90));
  }
  s.cable({{-2.1f, 1.9f, -2.6f}, {-1.2f, 1.6f, -2.4f}, {-0.3f, 1.75f, -2.2f}}, 0.008f, iron);
  for (float x : {-1.7f, -1.2f, -0.75f})
    s.ball({x, 1.6f, -2.42f}, 0.055f, s.plain(paints::color(draw)));
}

}  // namespace

World garden(uint64_t seed) {
  WorldBuilder s("garden", seed);
  ground(s);
  fence(s);
  arch(s);
  flower_bed(s, {-2.6f, 0, -1.65f}, 2.0f, 0.45f, 34);
  flower_bed(s, {1.0f, 0, -1.5f}, 1.4f, 0.5f, 26);
  flower_bed(s, {-1.35f, 0, 0.25f}, 0.8f, 0.4f, 16);
  shed(s);
  things(s);
  s.sun({0.5f, 0.9f, 0.7f}, {0.72f, 0.66f, 0.55f});
  s.world().ambient_up = {0.42f, 0.48f, 0.56f};
  s.world().ambient_down = {0.24f, 0.26f, 0.16f};
  s.world().background = {0.7f, 0.8f, 0.88f};
  s.world().rig = {
      {0.1f, 1.1f, 2.2f}, {0.1f, 0.75f, -1.5f}, {0.55f, 0.3f, 0.35f}, {0.4f, 0.25f, 0.1f}};
  return s.finish();
}

}  // namespace jade::world::worlds
