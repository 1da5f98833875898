// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "jade/world/worlds.h"
#include "jade/world/worlds/furnish.h"

namespace jade::world::worlds {
namespace {

void street(WorldBuilder& s) {
  s.quad(
      {-5, 4.5f, -2.6f}, {10, 0, 0}, {0, -4.5f, 0},
      s.material(paints::bricks({0.72f, 0.56f, 0.42f}, {0.8f, 0.76f, 0.68f}, 10, s.noise_seed())),
      1.2f);
  s.quad(
      {-5, 0, -2.6f}, {10, 0, 0}, {0, 0, 6},
      s.material(paints::cobbles({0.58f, 0.56f, 0.54f}, {0.24f, 0.23f, 0.22f}, 8, s.noise_seed())),
      1.1f);
  for (float x : {-2.0f, 1.6f}) {
    Canvas window(192, 256, {0.14f, 0.17f, 0.22f});
    window.rect(0.1f, 0.08f, 0.46f, 0.5f, {0.42f, 0.5f, 0.58f})
        .rect(0.56f, 0.55f, 0.9f, 0.94f, {0.85f, 0.72f, 0.45f});
    window.frame(0, 0, 1, 1, 0.07f, {0.25f, 0.42f, 0.38f})
        .rect(0.47f, 0, 0.53f, 1, {0.25f, 0.42f, 0.38f});
    s.quad({x, 2.7f, -2.58f}, {0.9f, 0, 0}, {0, -1.2f, 0}, s.material(window));
    for (float dx : {-0.42f, 0.94f})
      s.box({x + dx + 0.2f, 1.48f, -2.55f}, {0.38f, 1.24f, 0.04f},
            s.material(paints::stripes({0.26f, 0.46f, 0.42f}, {0.18f, 0.34f, 0.32f}, 12, false)));
  }
  Canvas sign(384, 96, {0.55f, 0.14f, 0.12f});
  sign.frame(0.01f, 0.04f, 0.99f, 0.96f, 0.012f, {0.9f, 0.78f, 0.45f})
      .text("FRESH MARKET", 0.1f, 0.26f, 0.48f, {0.95f, 0.88f, 0.65f}, 0.95f);
  s.box({-0.25f, 2.45f, -2.5f}, {1.5f, 0.4f, 0.08f},
        {s.material(sign), s.plain({0.4f, 0.1f, 0.08f}), s.plain({0.4f, 0.1f, 0.08f})});
}

void awning(WorldBuilder& s, float left, float width, float z, Rgb color) {
  const int cloth = s.material(paints::stripes(color, {0.93f, 0.91f, 0.86f}, 7, true));
  s.quad({left, 2.05f, z - 1.0f}, {width, 0, 0}, {0, -0.35f, 1.15f}, cloth);
  Canvas edge(512, 64, {});
  edge.shade([=](float u, float, Rgb) {
    return static_cast<int>(u * 14) % 2 ? Rgb{0.93f, 0.91f, 0.86f} : color;
  });
  edge.cut(
      [](float u, float v) { return v < 0.55f + 0.4f * std::abs(std::sin(u * 14 * 3.14159f)); });
  s.quad({left, 1.7f, z + 0.15f}, {width, 0, 0}, {0, -0.16f, 0}, s.cutout(edge));
  const int pole = s.material(paints::metal({0.7f, 0.7f, 0.7f}, s.noise_seed()));
  for (float x : {left + 0.04f, left + width - 0.04f})
    s.tube({x, 0, z + 0.12f}, {x, 1.72f, z + 0.12f}, 0.018f, 0.018f, pole);
}

/// A tilted crate full of one fruit, with a price card.
void fruit_crate(WorldBuilder& s, Vec3 corner, float width, Rgb fruit, float radius, bool round) {
  Draw& draw = s.draw();
  const int slats = s.material(paints::crate(paints::word(draw), s.noise_seed()));
  const float depth = 0.42f;
  s.box(corner + Vec3{width / 2, 0, 0}, {width, 0.13f, 0.02f}, slats);
  for (float x : {0.0f, width})
    s.quad(corner + Vec3{x, 0.13f, 0}, {0, 0.12f, -depth}, {0, -0.13f, 0}, slats);
  s.quad(corner + Vec3{0, 0.02f, 0}, {width, 0, 0}, {0, 0.12f, -depth},
         s.plain({0.3f, 0.22f, 0.14f}));
  const int skins[] = {s.material(paints::marble(fruit, fruit * 0.75f, s.noise_seed())),
                       s.material(paints::plaster(fruit * 1.15f, s.noise_seed())),
                       s.material(paints::marble(fruit * 0.9f, mix(fruit, {0.5f, 0.6f, 0.2f}, 0.5f),
                                                 s.noise_seed()))};
  for (float z = radius; z < depth - radius; z += 1.75f * radius) {
    for (float x = radius; x < width - radius / 2; x += 1.95f * radius) {
      const Vec3 at = corner + Vec3{x + draw.range(-0.15f, 0.15f) * radius,
                                    0.07f + 0.28f * z + radius + draw.range(0, 0.4f) * radius, -z};
      const Vec3 size = round ? Vec3{radius, radius * draw.range(0.86f, 1.0f), radius}
                              : Vec3{radius * 1.7f, radius * 0.6f, radius * 0.7f};
      s.ellipsoid(at, size, skins[draw.pick(3)], draw.range(0, 180), draw.range(-20, 20));
    }
  }
  Canvas card(160, 96, {0.96f, 0.94f, 0.86f});
  card.frame(0, 0, 1, 1, 0.03f, {0.15f, 0.35f, 0.2f})
      .text(std::to_string(1 + draw.pick(5)) + "." + std::to_string(10 + draw.pick(89)), 0.14f,
            0.2f, 0.42f, {0.75f, 0.12f, 0.1f});
  card.text("KILO", 0.3f, 0.7f, 0.16f, {0.1f, 0.1f, 0.1f});
  const Vec3 at = corner + Vec3{width * 0.35f, 0.36f, -0.2f};
  s.quad(at, {0.16f, 0, 0.01f}, {0, -0.1f, 0.02f}, s.material(card));
  s.tube(at + Vec3{0.08f, -0.22f, 0}, at + Vec3{0.08f, -0.05f, 0}, 0.004f, 0.004f,
         s.plain({0.2f, 0.2f, 0.2f}));
}

void stall(WorldBuilder& s, float left, float z) {
  const int cloth = s.material(paints::fabric({0.28f, 0.46f, 0.34f}, {0.9f, 0.88f, 0.8f},
                                              {0.6f, 0.2f, 0.2f}, 5, s.noise_seed()));
  s.box({left + 1.25f, 0, z - 0.45f}, {2.6f, 0.72f, 1.0f}, cloth, 0, 0.6f);
  const Rgb fruits[] = {{0.85f, 0.2f, 0.14f},  {0.95f, 0.58f, 0.12f}, {0.92f, 0.84f, 0.25f},
                        {0.45f, 0.66f, 0.22f}, {0.5f, 0.22f, 0.45f},  {0.95f, 0.72f, 0.5f}};
  const float radii[] = {0.048f, 0.055f, 0.045f, 0.05f, 0.036f, 0.046f};
  for (int i = 0; i < 4; ++i) {
    fruit_crate(s, {left + 0.02f + 0.63f * static_cast<float>(i), 0.72f, z}, 0.58f, fruits[i],
                radii[i], i != 2);
  }
  s.box({left + 1.25f, 0.72f, z - 0.75f}, {2.6f, 0.26f, 0.5f}, s.plain({0.45f, 0.33f, 0.2f}));
  for (int i = 0; i < 3; ++i) {
    fruit_crate(s, {left + 0.1f + 0.8f * static_cast<float>(i), 0.98f, z - 0.5f}, 0.6f,
                fruits[(i + 3) % 6], radii[(i + 3) % 6], true);
  }
}

void hanging(WorldBuilder& s) {
  Draw& draw = s.draw();
  const int wire = s.plain({0.1f, 0.1f, 0.1f}),
            glow = s.material(Canvas(4, 4, {1.0f, 0.9f, 0.65f}), 0.9f);
  s.cable({{-2.4f, 2.3f, 0.3f},
           {-1.2f, 1.95f, 0.2f},
           {0.0f, 1.85f, 0.15f},
           {1.2f, 1.95f, 0.2f},
           {2.4f, 2.3f, 0.3f}},
          0.008f, wire);
  for (float x : {-1.6f, -0.8f, 0.0f, 0.8f, 1.6f})
    s.ball({x, 1.8f + 0.1f * x * x / 2, 0.17f}, 0.035f, glow);
  for (int i = 0; i < 9; ++i) {  // pennants across the street
    const float x = -2.2f + 0.5f * static_cast<float>(i);
    Canvas flag(64, 64, paints::color(draw));
    flag.ellipse(0.5f, 0.3f, 0.16f, 0.16f, {0.95f, 0.93f, 0.85f}).cut([](float u, float v) {
      return std::abs(u - 0.5f) < 0.5f * (1 - v);
    });
    s.quad({x, 2.35f + 0.03f * x * x, -1.6f}, {0.3f, 0, 0}, {0, -0.34f, 0.02f}, s.cutout(flag));
  }
  s.tube({-2.6f, 2.5f, -1.6f}, {2.6f, 2.5f, -1.6f}, 0.006f, 0.006f, wire);
  // Scales hang at the front, garlic strings beside them.
  const int steel = s.material(paints::metal({0.75f, 0.75f, 0.76f}, s.noise_seed()));
  s.tube({0.62f, 1.72f, 0.1f}, {0.62f, 1.5f, 0.1f}, 0.005f, 0.005f, wire);
  s.tube({0.62f, 1.42f, 0.05f}, {0.62f, 1.42f, 0.14f}, 0.1f, 0.1f, steel);
  s.disc({0.62f, 1.42f, 0.145f}, {0.09f, 0, 0}, {0, -0.09f, 0},
         s.material(paints::clock_face(s.noise_seed())));
  for (float dx : {-0.12f, 0.12f})
    s.tube({0.62f + 0.5f * dx, 1.34f, 0.1f}, {0.62f + dx, 1.16f, 0.1f}, 0.003f, 0.003f, wire);
  s.ellipsoid({0.62f, 1.15f, 0.1f}, {0.15f, 0.035f, 0.12f}, steel);
  const int garlic = s.material(paints::plaster({0.88f, 0.82f, 0.76f}, s.noise_seed()));
  for (int i = 0; i < 9; ++i)
    s.ball(
        {-0.72f + 0.03f * static_cast<float>(i % 2), 1.62f - 0.055f * static_cast<float>(i), 0.12f},
        0.036f, garlic);
}

}  // namespace

World market(uint64_t seed) {
  WorldBuilder s("market", seed);
  street(s);
  stall(s, -1.3f, 0.0f);
  awning(s, -1.45f, 2.9f, 0.0f, {0.72f, 0.2f, 0.16f});
  awning(s, -2.9f, 1.3f, -1.2f, {0.2f, 0.4f, 0.58f});
  awning(s, 1.6f, 1.4f, -1.3f, {0.3f, 0.5f, 0.3f});
  hanging(s);
  plant(s, {-1.55f, 0, 0.35f}, 0.8f);
  s.tube({1.5f, 0, 0.25f}, {1.5f, 0.5f, 0.25f}, 0.22f, 0.24f,
         s.material(paints::basket({0.78f, 0.6f, 0.36f}, {0.4f, 0.28f, 0.15f}, 12)));
  for (int i = 0; i < 12; ++i) {  // loaves
    s.ellipsoid(
        {1.42f + s.draw().range(-0.08f, 0.22f), 0.5f + s.draw().range(0, 0.1f),
         0.25f + s.draw().range(-0.12f, 0.12f)},
        {0.14f, 0.05f, 0.05f},
        s.material(paints::marble({0.8f, 0.56f, 0.3f}, {0.5f, 0.28f, 0.12f}, s.noise_seed())),
        s.draw().range(0, 180), s.draw().range(10, 60));
  }
  s.sun({-0.5f, 0.85f, 0.9f}, {0.62f, 0.57f, 0.48f});
  s.lamp({0.0f, 1.75f, 0.4f}, {0.12f, 0.1f, 0.07f}, 0.2f);
  s.world().ambient_up = {0.46f, 0.48f, 0.52f};
  s.world().rig = {{0, 1.5f, 2.2f}, {0, 1.15f, -0.3f}, {0.5f, 0.25f, 0.3f}, {0.32f, 0.2f, 0.1f}};
  return s.finish();
}

}  // namespace jade::world::worlds
