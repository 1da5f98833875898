// SPDX-License-Identifier: Apache-2.0
// A hall of pictures and plinths, rearranged by the seed: training data for restorers.
#include <cmath>

#include "jade/world/worlds.h"
#include "jade/world/worlds/furnish.h"

namespace jade::world::worlds {
namespace {

Canvas any_surface(WorldBuilder& s) {
  Draw& draw = s.draw();
  const Rgb a = paints::color(draw), b = paints::color(draw), c = paints::color(draw);
  switch (draw.pick(8)) {
    case 0:
      return paints::planks(a, b, 3 + draw.pick(6), s.noise_seed());
    case 1:
      return paints::bricks(a, c, 4 + 2 * draw.pick(5), s.noise_seed());
    case 2:
      return paints::tiles(a, b, c, 3 + draw.pick(5), s.noise_seed());
    case 3:
      return paints::marble(a, b, s.noise_seed());
    case 4:
      return paints::cobbles(a, b * 0.5f, 4 + draw.pick(8), s.noise_seed());
    case 5:
      return paints::fabric(a, b, c, 2 + draw.pick(5), s.noise_seed());
    case 6:
      return paints::concrete(s.noise_seed());
    default:
      return paints::plaster(a, s.noise_seed());
  }
}

Canvas any_print(WorldBuilder& s) {
  Draw& draw = s.draw();
  switch (draw.pick(6)) {
    case 0:
      return paints::page(s.noise_seed());
    case 1:
      return paints::poster(paints::word(draw), s.noise_seed());
    case 2:
      return paints::map_sheet(s.noise_seed());
    case 3:
      return paints::calendar(s.noise_seed());
    case 4:
      return paints::circuit(s.noise_seed());
    default:
      return paints::painting(s.noise_seed());
  }
}

void exhibit(WorldBuilder& s, Vec3 base) {
  Draw& draw = s.draw();
  const int skin = s.material(any_surface(s));
  const float size = draw.range(0.1f, 0.24f);
  switch (draw.pick(5)) {
    case 0:
      s.ball(base + Vec3{0, size, 0}, size, skin);
      break;
    case 1:
      for (int i = 0; i < 4; ++i)
        s.box(base + Vec3{0, 0.12f * static_cast<float>(i), 0},
              {size * (1.6f - 0.3f * static_cast<float>(i)), 0.12f, size}, skin, draw.range(0, 90));
      break;
    case 2:
      for (int i = 0; i < 9; ++i) {
        const float a = 0.7f * static_cast<float>(i);
        s.tube(base + Vec3{size * std::cos(a), 0, size * std::sin(a)},
               base + Vec3{-0.5f * size * std::cos(a), draw.range(0.3f, 0.6f),
                           -0.5f * size * std::sin(a)},
               0.012f, 0.008f, skin);
      }
      break;
    case 3: {
      std::vector<Vec3> knot;
      for (int i = 0; i < 12; ++i)
        knot.push_back(base + Vec3{draw.range(-size, size), 0.1f + draw.range(0, 2 * size),
                                   draw.range(-size, size)});
      s.cable(knot, draw.range(0.008f, 0.03f), skin);
      break;
    }
    default:
      plant(s, base, 2.2f * size);
  }
}

}  // namespace

World gallery(uint64_t seed) {
  WorldBuilder s("gallery", seed);
  Draw& draw = s.draw();
  s.quad({-4, 3, -1.4f}, {8, 0, 0}, {0, -3, 0}, s.material(any_surface(s)), draw.range(0.8f, 2.5f));
  s.quad({-4, 0, -1.4f}, {8, 0, 0}, {0, 0, 5}, s.material(any_surface(s)), draw.range(0.8f, 2.0f));
  for (int i = 0; i < 9; ++i) {
    const float w = draw.range(0.3f, 0.8f), h = w * draw.range(0.7f, 1.3f);
    s.quad({-2.2f + 0.5f * static_cast<float>(i), draw.range(1.3f, 2.4f),
            -1.37f + draw.range(0, 0.02f)},
           {w, 0, 0}, {0, -h, 0}, s.material(any_print(s)));
  }
  for (int i = 0; i < 9; ++i) {
    const Vec3 at{-1.7f + 0.42f * static_cast<float>(i) + draw.range(-0.1f, 0.1f), 0,
                  draw.range(-1.0f, 0.5f)};
    const float h = draw.range(0.4f, 0.95f);
    s.box(at, {draw.range(0.22f, 0.4f), h, draw.range(0.22f, 0.4f)}, s.material(any_surface(s)),
          draw.range(-40, 40));
    exhibit(s, at + Vec3{0, h, 0});
  }
  const int rope = s.plain(paints::color(draw));
  for (int i = 0; i < 3; ++i) {
    const float x = -1.2f + 1.0f * static_cast<float>(i), z = 0.75f;
    s.tube({x, 0, z}, {x, 0.8f, z}, 0.02f, 0.02f, rope, rope);
    s.cable({{x, 0.78f, z}, {x + 0.5f, 0.6f, z}, {x + 1.0f, 0.78f, z}}, 0.014f, rope);
  }
  for (int i = 0; i < 2; ++i) {
    s.lamp({draw.range(-2, 2), draw.range(1.8f, 2.8f), draw.range(0.2f, 2.0f)},
           {draw.range(0.5f, 1.3f), draw.range(0.5f, 1.2f), draw.range(0.4f, 1.1f)}, 0.15f);
  }
  s.world().ambient_up = Rgb{0.4f, 0.4f, 0.42f} * draw.range(0.6f, 1.5f);
  s.world().rig = {{0, 1.3f, 2.4f}, {0, 1.1f, -0.4f}, {0.6f, 0.3f, 0.4f}, {0.4f, 0.25f, 0.1f}};
  return s.finish();
}

}  // namespace jade::world::worlds
