// SPDX-License-Identifier: Apache-2.0
// Solids of every kind piled in front of a wall, sampled by the seed: training data for restorers.
#include <cmath>

#include "jade/world/worlds.h"
#include "jade/world/worlds/furnish.h"

namespace jade::world::worlds {
namespace {

int any_material(WorldBuilder& s) {
  Draw& draw = s.draw();
  const Rgb a = paints::color(draw), b = paints::color(draw), c = paints::color(draw);
  switch (draw.pick(12)) {
    case 0:
      return s.material(paints::wood(a, b, draw.range(4, 12), s.noise_seed()));
    case 1:
      return s.material(paints::checker(a, b, 3 + draw.pick(6), s.noise_seed()));
    case 2:
      return s.material(paints::stripes(a, b, 3 + draw.pick(12), draw.pick(2)));
    case 3:
      return s.material(paints::label(paints::word(draw), a, b, s.noise_seed()));
    case 4:
      return s.material(paints::metal(a, s.noise_seed()));
    case 5:
      return s.material(paints::carpet(a, b, c, s.noise_seed()));
    case 6:
      return s.material(paints::foliage(a, b, s.noise_seed()));
    case 7:
      return s.material(paints::page(s.noise_seed()));
    case 8:
      return s.material(paints::rust(s.noise_seed()));
    case 9:
      return s.material(paints::screen(s.noise_seed()));
    case 10:
      return s.material(paints::gravel(s.noise_seed()));
    default:
      return s.plain(a);
  }
}

void solid(WorldBuilder& s, const std::vector<int>& skins) {
  Draw& draw = s.draw();
  const Vec3 at{draw.range(-1.6f, 1.6f), draw.range(0.0f, 1.9f), draw.range(-1.0f, 0.5f)};
  const float size = draw.range(0.06f, 0.35f);
  const int skin = skins[static_cast<size_t>(draw.pick(static_cast<int>(skins.size())))];
  const Vec3 way = normalized({draw.range(-1, 1), draw.range(-1, 1), draw.range(-1, 1) + 0.01f});
  switch (draw.pick(6)) {
    case 0:
    case 1:
      s.box(at, {size, size * draw.range(0.3f, 1.6f), size * draw.range(0.3f, 1.2f)}, skin,
            draw.range(0, 90));
      break;
    case 2:
      s.ellipsoid(at, {0.5f * size, 0.5f * size * draw.range(0.5f, 1.2f), 0.4f * size}, skin,
                  draw.range(0, 180), draw.range(-40, 40));
      break;
    case 3:
      s.tube(at, at + way * (1.2f * size), 0.25f * size, 0.25f * size * draw.range(0.3f, 1.3f),
             skin, skin);
      break;
    case 4:
      s.tube(at - way * 0.5f, at + way * 0.5f, 0.01f, 0.01f, skin);
      break;
    default: {
      const Vec3 across = perpendicular(way);
      s.quad(at, way * size, across * (size * draw.range(0.6f, 1.4f)), skin);
    }
  }
}

}  // namespace

World clutter(uint64_t seed) {
  WorldBuilder s("clutter", seed);
  Draw& draw = s.draw();
  std::vector<int> skins;
  for (int i = 0; i < 26; ++i) skins.push_back(any_material(s));
  s.quad({-4, 4, -1.3f}, {8, 0, 0}, {0, -5, 0}, skins[0], draw.range(0.7f, 2));
  s.quad({-4, -0.2f, -1.3f}, {8, 0, 0}, {0, 0, 5}, skins[1], draw.range(0.7f, 2));
  for (int i = 0; i < 150; ++i) solid(s, skins);
  for (int i = 0; i < 3; ++i) {
    const Vec3 at{draw.range(-1.2f, 1.2f), draw.range(0.3f, 1.5f), draw.range(-0.5f, 0.6f)};
    s.cable({at, at + Vec3{0.4f, draw.range(-0.4f, 0.4f), 0},
             at + Vec3{0.9f, draw.range(-0.4f, 0.4f), 0}, at + Vec3{1.3f, 0, 0}},
            draw.range(0.005f, 0.015f), skins[static_cast<size_t>(i)]);
  }
  s.lamp({draw.range(-1.5f, 1.5f), 2.4f, draw.range(1.0f, 2.2f)},
         {draw.range(0.8f, 2.2f), draw.range(0.8f, 2.0f), draw.range(0.8f, 1.9f)}, 0.2f);
  s.world().ambient_up = Rgb{0.42f, 0.44f, 0.46f} * draw.range(0.5f, 1.4f);
  s.world().rig = {{0, 1.0f, 2.4f}, {0, 0.9f, -0.3f}, {0.6f, 0.4f, 0.4f}, {0.4f, 0.3f, 0.1f}};
  return s.finish();
}

}  // namespace jade::world::worlds
