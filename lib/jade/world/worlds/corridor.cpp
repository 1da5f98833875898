// SPDX-License-Identifier: Apache-2.0
#include "jade/world/worlds.h"
#include "jade/world/worlds/furnish.h"

namespace jade::world::worlds {
namespace {

constexpr float kHalf = 1.15f, kEnd = -5.5f, kHeight = 2.5f;

void shell(WorldBuilder& s) {
  const int floor = s.material(paints::tiles({0.82f, 0.78f, 0.7f}, {0.3f, 0.34f, 0.38f},
                                             {0.5f, 0.48f, 0.45f}, 6, s.noise_seed()));
  s.quad({-kHalf, 0, kEnd}, {2 * kHalf, 0, 0}, {0, 0, 9}, floor, 1.8f);
  const int wall = s.material(paints::plaster({0.78f, 0.76f, 0.7f}, s.noise_seed()));
  const int dado =
      s.material(paints::planks({0.36f, 0.46f, 0.46f}, {0.26f, 0.34f, 0.35f}, 8, s.noise_seed()));
  for (float side : {-1.0f, 1.0f}) {
    s.quad({side * kHalf, kHeight, kEnd}, {0, 0, 9}, {0, -1.6f, 0}, wall, 1.7f);
    s.quad({side * kHalf, 0.9f, kEnd}, {0, 0, 9}, {0, -0.9f, 0}, dado, 1.1f);
    s.box({side * (kHalf - 0.015f), 0.88f, kEnd + 4.5f}, {0.03f, 0.05f, 9},
          s.plain({0.85f, 0.82f, 0.75f}));
  }
  s.quad(
      {-kHalf, kHeight, kEnd}, {2 * kHalf, 0, 0}, {0, 0, 9},
      s.material(paints::checker({0.85f, 0.85f, 0.83f}, {0.74f, 0.74f, 0.72f}, 4, s.noise_seed())),
      1.2f);
  s.quad({-kHalf, kHeight, kEnd}, {2 * kHalf, 0, 0}, {0, -kHeight, 0},
         s.material(paints::bricks({0.62f, 0.3f, 0.22f}, {0.72f, 0.68f, 0.62f}, 8, s.noise_seed())),
         0.8f);
}

void door(WorldBuilder& s, float side, float z, Rgb color) {
  Canvas leaf = Canvas(256, 512, color).mottle(12, 0.08f, s.noise_seed());
  for (float y : {0.06f, 0.53f}) {
    for (float x : {0.1f, 0.55f}) leaf.frame(x, y, x + 0.35f, y + 0.4f, 0.02f, color * 0.6f);
  }
  leaf.ellipse(side < 0 ? 0.08f : 0.92f, 0.5f, 0.035f, 0.018f, {0.85f, 0.75f, 0.4f});
  leaf.text("ROOM " + std::to_string(s.draw().pick(90) + 10), 0.3f, 0.02f, 0.03f,
            {0.95f, 0.92f, 0.85f});
  const float x = side * (kHalf - 0.02f);
  s.quad({x, 2.05f, z - 0.45f}, {0, 0, 0.9f}, {0, -2.05f, 0}, s.material(leaf));
  const int trim = s.plain({0.9f, 0.88f, 0.82f});
  for (float dz : {-0.5f, 0.5f}) s.box({x, 0, z + dz}, {0.06f, 2.1f, 0.08f}, trim);
  s.box({x, 2.05f, z}, {0.06f, 0.08f, 1.08f}, trim);
}

void pictures(WorldBuilder& s) {
  for (int i = 0; i < 3; ++i) {
    const float z = -0.7f - 1.6f * static_cast<float>(i);
    s.quad({-kHalf + 0.02f, 1.85f, z + 0.35f}, {0, 0, -0.7f}, {0, -0.55f, 0},
           s.material(paints::painting(s.noise_seed())));
    s.quad({kHalf - 0.02f, 1.8f, z - 1.0f}, {0, 0, 0.55f}, {0, -0.72f, 0},
           s.material(paints::poster(paints::word(s.draw()), s.noise_seed())));
  }
  s.quad({kHalf - 0.02f, 1.75f, 0.45f}, {0, 0, 0.8f}, {0, -0.6f, 0},
         s.material(paints::map_sheet(s.noise_seed())));
}

void pipes(WorldBuilder& s) {
  const int copper = s.material(paints::metal({0.78f, 0.48f, 0.3f}, s.noise_seed()));
  const int white = s.material(paints::metal({0.8f, 0.82f, 0.84f}, s.noise_seed()));
  s.tube({-0.85f, 2.38f, kEnd}, {-0.85f, 2.38f, 3}, 0.035f, 0.035f, copper);
  s.tube({-0.72f, 2.36f, kEnd}, {-0.72f, 2.36f, 3}, 0.05f, 0.05f, white);
  for (int i = 0; i < 8; ++i)
    s.tube({-0.72f, 2.36f, 0.9f * static_cast<float>(i) - 5},
           {-0.72f, 2.36f, 0.9f * static_cast<float>(i) - 4.96f}, 0.062f, 0.062f, copper);
  const int cable = s.plain({0.1f, 0.1f, 0.11f});
  s.cable({{0.95f, 2.45f, 1.4f},
           {0.9f, 2.2f, 0.6f},
           {1.0f, 2.3f, -0.4f},
           {0.9f, 2.15f, -1.4f},
           {1.0f, 2.4f, -2.6f}},
          0.012f, cable);
}

void furniture(WorldBuilder& s) {
  plant(s, {0.78f, 0, -0.35f}, 1.0f);
  const int wood =
      s.material(paints::wood({0.55f, 0.36f, 0.2f}, {0.32f, 0.19f, 0.1f}, 6, s.noise_seed()));
  s.box({-0.86f, 0.66f, -0.5f}, {0.46f, 0.05f, 1.0f}, wood);
  for (float z : {-0.95f, -0.05f}) s.box({-0.8f, 0, z}, {0.3f, 0.66f, 0.06f}, wood);
  book_pile(s, {-0.85f, 0.71f, -0.25f}, 4);
  tin(s, {-0.82f, 0.71f, -0.75f}, 0.07f, 0.2f);
  parcel(s, {0.6f, 0, -2.2f}, {0.6f, 0.45f, 0.5f}, -14);
  parcel(s, {0.62f, 0.45f, -2.2f}, {0.42f, 0.34f, 0.4f}, 9);
  s.box({-0.6f, 0, -2.9f}, {0.7f, 0.5f, 0.5f}, s.material(paints::crate("FRAGILE", s.noise_seed())),
        10);
  const int bucket =
      s.material(paints::label("CLEAN", {0.85f, 0.3f, 0.2f}, {0.2f, 0.2f, 0.3f}, s.noise_seed()));
  s.tube({0.15f, 0, -1.2f}, {0.15f, 0.3f, -1.2f}, 0.13f, 0.17f, bucket,
         s.plain({0.1f, 0.1f, 0.1f}));
  s.tube({0.2f, 0.05f, -1.25f}, {0.62f, 1.5f, -1.7f}, 0.013f, 0.013f, s.plain({0.8f, 0.65f, 0.3f}));
  s.quad({-0.55f, 0.004f, -4.6f}, {1.1f, 0, 0}, {0, 0, 4.6f},
         s.material(paints::carpet({0.3f, 0.24f, 0.42f}, {0.75f, 0.6f, 0.3f}, {0.6f, 0.2f, 0.2f},
                                   s.noise_seed())),
         1.1f);
}

void lights(WorldBuilder& s) {
  const int glow = s.material(Canvas(4, 4, {0.98f, 0.97f, 0.92f}), 1.4f);
  for (float z : {0.9f, -1.3f, -3.6f}) {
    s.box({0.1f, kHeight - 0.05f, z}, {0.6f, 0.045f, 0.16f}, glow);
    s.lamp({0.1f, kHeight - 0.12f, z},
           z == -1.3f ? Rgb{0.3f, 0.3f, 0.3f} : Rgb{0.95f, 0.93f, 0.85f}, 0.15f);
  }
  Canvas exit_sign(128, 64, {0.1f, 0.55f, 0.25f});
  exit_sign.text("EXIT", 0.12f, 0.25f, 0.5f, {0.95f, 1, 0.95f});
  s.box({0, 2.05f, kEnd + 0.08f}, {0.44f, 0.2f, 0.05f}, s.material(exit_sign, 0.8f));
}

}  // namespace

World corridor(uint64_t seed) {
  WorldBuilder s("corridor", seed);
  shell(s);
  door(s, -1, 0.75f, paints::color(s.draw()));
  door(s, -1, -3.3f, paints::color(s.draw()));
  door(s, 1, -3.0f, paints::color(s.draw()));
  Canvas exit_door(256, 512, {0.25f, 0.4f, 0.5f});
  exit_door.rect(0.2f, 0.1f, 0.8f, 0.45f, {0.8f, 0.88f, 0.92f})
      .frame(0, 0, 1, 1, 0.04f, {0.85f, 0.85f, 0.8f});
  s.quad({-0.5f, 2.0f, kEnd + 0.03f}, {1.0f, 0, 0}, {0, -2.0f, 0}, s.material(exit_door));
  pictures(s);
  pipes(s);
  furniture(s);
  lights(s);
  s.world().ambient_up = {0.26f, 0.26f, 0.27f};
  s.world().exposure = 1.7f;
  s.world().rig = {{0.05f, 1.4f, 2.3f}, {0, 1.2f, -1.5f}, {0.4f, 0.3f, 0.45f}, {0.3f, 0.25f, 0.1f}};
  return s.finish();
}

}  // namespace jade::world::worlds
