// SPDX-License-Identifier: Apache-2.0
#include "jade/world/worlds.h"
#include "jade/world/worlds/furnish.h"

namespace jade::world::worlds {
namespace {

void room(WorldBuilder& s) {
  const int wall =
      s.material(paints::bricks({0.74f, 0.5f, 0.4f}, {0.8f, 0.77f, 0.72f}, 8, s.noise_seed()));
  s.quad({-3, 2.6f, -0.75f}, {6, 0, 0}, {0, -2.6f, 0}, wall, 0.9f);
  const int board =
      s.material(paints::planks({0.6f, 0.42f, 0.26f}, {0.42f, 0.27f, 0.16f}, 6, s.noise_seed()));
  s.quad({-3, 0, -0.75f}, {6, 0, 0}, {0, 0, 4}, board, 1.4f);
}

void table(WorldBuilder& s) {
  const int top =
      s.material(paints::wood({0.82f, 0.64f, 0.42f}, {0.55f, 0.36f, 0.2f}, 9, s.noise_seed()));
  const int leg = s.plain({0.25f, 0.26f, 0.28f});
  s.box({0, 0.7f, 0}, {2.6f, 0.05f, 1.1f}, top);
  for (float x : {-1.2f, 1.2f}) s.tube({x, 0, 0.45f}, {x, 0.7f, 0.45f}, 0.025f, 0.025f, leg);
}

void computer(WorldBuilder& s) {
  const int black = s.plain({0.1f, 0.1f, 0.11f});
  const int code = s.material(paints::screen(s.noise_seed()), 0.75f);
  s.box({-0.05f, 0.95f, -0.38f}, {0.86f, 0.54f, 0.04f}, {black, black, black});
  s.quad({-0.455f, 1.47f, -0.355f}, {0.81f, 0, 0}, {0, -0.49f, 0}, code);
  s.tube({-0.05f, 0.76f, -0.4f}, {-0.05f, 1.0f, -0.4f}, 0.025f, 0.02f, black);
  s.box({-0.05f, 0.75f, -0.38f}, {0.3f, 0.015f, 0.2f}, black);
  const int keys = s.material(paints::keyboard());
  s.box({-0.1f, 0.75f, 0.18f}, {0.58f, 0.025f, 0.2f}, {s.plain({0.2f, 0.2f, 0.22f}), black, keys},
        4);
  s.ellipsoid({0.36f, 0.765f, 0.22f}, {0.045f, 0.03f, 0.07f}, s.plain({0.85f, 0.85f, 0.84f}), 15);
  s.cable(
      {{0.36f, 0.77f, 0.15f}, {0.42f, 0.757f, 0.0f}, {0.3f, 0.757f, -0.15f}, {0.1f, 0.8f, -0.36f}},
      0.006f, black);
  s.cable({{-0.35f, 0.76f, 0.12f},
           {-0.6f, 0.757f, 0.05f},
           {-0.45f, 0.757f, -0.2f},
           {-0.1f, 0.8f, -0.38f}},
          0.007f, s.plain({0.7f, 0.25f, 0.15f}));
}

void clutter_on_top(WorldBuilder& s) {
  Draw& draw = s.draw();
  book_pile(s, {-0.88f, 0.75f, 0.05f}, 5);
  mug(s, {-0.87f, 0.98f, 0.05f}, 0.11f,
      s.material(paints::stripes({0.9f, 0.88f, 0.82f}, {0.2f, 0.42f, 0.62f}, 5, false)));
  mug(s, {0.58f, 0.75f, 0.3f}, 0.13f,
      s.material(paints::checker({0.92f, 0.9f, 0.85f}, {0.75f, 0.25f, 0.2f}, 6, s.noise_seed())));
  pencils(s, {-0.56f, 0.75f, -0.1f});
  desk_lamp(s, {0.66f, 0.75f, -0.2f});
  plant(s, {1.05f, 0.75f, -0.15f}, 0.42f);
  const int sheet = s.material(paints::page(s.noise_seed())),
            chip = s.material(paints::circuit(s.noise_seed()));
  s.box({0.3f, 0.75f, 0.42f}, {0.24f, 0.004f, 0.32f}, sheet, draw.range(8, 25));
  s.box({-0.62f, 0.75f, 0.38f}, {0.26f, 0.012f, 0.22f}, chip, draw.range(-25, -8));
  s.box({0.02f, 0.75f, 0.44f}, {0.36f, 0.004f, 0.034f}, s.material(paints::ruler()),
        draw.range(-12, 12));
  tin(s, {0.92f, 0.75f, 0.3f}, 0.055f, 0.16f);
  s.ball({-0.3f, 0.785f, 0.42f}, 0.035f,
         s.material(paints::marble({0.9f, 0.9f, 0.92f}, {0.2f, 0.35f, 0.6f}, s.noise_seed())));
  parcel(s, {-1.05f, 0.75f, -0.32f}, {0.34f, 0.3f, 0.26f}, 12);
}

void wall_things(WorldBuilder& s) {
  const int shelf =
      s.material(paints::wood({0.5f, 0.34f, 0.2f}, {0.3f, 0.19f, 0.1f}, 7, s.noise_seed()));
  s.box({0.75f, 1.52f, -0.62f}, {1.1f, 0.03f, 0.24f}, shelf);
  book_row(s, {0.24f, 1.55f, -0.5f}, 0.7f, 0.27f, 0.2f);
  tin(s, {1.08f, 1.55f, -0.6f}, 0.06f, 0.18f);
  s.quad({-1.15f, 1.95f, -0.735f}, {0.48f, 0, 0}, {0, -0.64f, 0},
         s.material(paints::poster(paints::word(s.draw()), s.noise_seed())));
  s.quad({-0.56f, 2.0f, -0.735f}, {0.52f, 0, 0}, {0, -0.4f, 0},
         s.material(paints::map_sheet(s.noise_seed())));
  s.disc({0.28f, 2.08f, -0.72f}, {0.14f, 0, 0}, {0, -0.14f, 0},
         s.material(paints::clock_face(s.noise_seed())));
  s.quad({-1.6f, 1.75f, -0.735f}, {0.32f, 0, 0}, {0, -0.4f, 0},
         s.material(paints::calendar(s.noise_seed())));
  // A wire with bulbs hangs in front of the wall.
  const int wire = s.plain({0.12f, 0.12f, 0.12f}), glow = s.plain({1.0f, 0.9f, 0.6f});
  s.cable({{-1.7f, 1.95f, -0.5f},
           {-1.0f, 1.72f, -0.45f},
           {-0.2f, 1.66f, -0.4f},
           {0.6f, 1.9f, -0.45f},
           {1.5f, 1.75f, -0.5f}},
          0.006f, wire);
  for (float x : {-1.35f, -0.7f, -0.2f, 0.25f})
    s.ball({x, 1.74f - 0.1f * (x > -1 ? 1.0f : -0.3f), -0.44f}, 0.022f, glow);
}

}  // namespace

World desk(uint64_t seed) {
  WorldBuilder s("desk", seed);
  room(s);
  table(s);
  computer(s);
  clutter_on_top(s);
  wall_things(s);
  s.lamp({-1.0f, 2.5f, 1.4f}, {1.6f, 1.5f, 1.35f}, 0.2f);
  s.world().ambient_up = {0.42f, 0.44f, 0.48f};
  s.world().rig = {{0, 1.3f, 2.1f}, {0, 1.12f, -0.2f}, {0.5f, 0.28f, 0.25f}, {0.3f, 0.16f, 0.1f}};
  return s.finish();
}

}  // namespace jade::world::worlds
