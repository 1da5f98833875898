// SPDX-License-Identifier: Apache-2.0
#include "jade/world/worlds/furnish.h"

#include <algorithm>
#include <cmath>

namespace jade::world::worlds {

void book_row(WorldBuilder& s, Vec3 left, float width, float height, float depth) {
  Draw& draw = s.draw();
  const int pages =
      s.material(paints::stripes({0.88f, 0.84f, 0.75f}, {0.7f, 0.66f, 0.58f}, 40, true));
  float x = 0;
  while (x < width - 0.03f) {
    const float w = std::min(draw.range(0.035f, 0.085f), width - x);
    const float h = height * draw.range(0.72f, 1.0f), d = depth * draw.range(0.8f, 1.0f);
    const Rgb cover = paints::color(draw);
    const Rgb ink =
        cover.r + cover.g + cover.b > 1.5f ? Rgb{0.1f, 0.1f, 0.12f} : Rgb{0.92f, 0.85f, 0.6f};
    std::string title = paints::word(draw);
    if (draw.pick(2)) title += " " + paints::word(draw);
    const int spine = s.material(paints::spine(title, cover, ink, s.noise_seed()));
    const Vec3 base = left + Vec3{x + w / 2, 0, -d / 2 - draw.range(0, 0.03f)};
    s.box(base, {w * 0.96f, h, d}, {spine, s.plain(cover), pages});
    x += w;
    if (draw.pick(14) == 0) x += draw.range(0.03f, 0.12f);
  }
}

void book_pile(WorldBuilder& s, Vec3 base, int count) {
  Draw& draw = s.draw();
  for (int i = 0; i < count; ++i) {
    const Rgb cover = paints::color(draw);
    Canvas side(256, 48, cover);
    side.text(paints::word(draw) + " " + paints::word(draw), 0.08f, 0.28f, 0.45f,
              {0.93f, 0.9f, 0.8f}, 0.8f);
    const int front = s.material(side);
    const int top = s.material(paints::poster(paints::word(draw), s.noise_seed()));
    const float h = draw.range(0.03f, 0.06f);
    s.box(base, {draw.range(0.26f, 0.36f), h, draw.range(0.2f, 0.26f)}, {front, front, top},
          draw.range(-18, 18));
    base.y += h;
  }
}

void mug(WorldBuilder& s, Vec3 base, float size, int material) {
  const Vec3 top = base + Vec3{0, size, 0};
  s.tube(base, top, 0.4f * size, 0.42f * size, material);
  s.disc(base + Vec3{0, 0.85f * size, 0}, {0.4f * size, 0, 0}, {0, 0, 0.4f * size},
         s.plain({0.2f, 0.11f, 0.06f}));
  s.cable({base + Vec3{0.38f * size, 0.25f * size, 0.1f * size},
           base + Vec3{0.68f * size, 0.3f * size, 0.15f * size},
           base + Vec3{0.68f * size, 0.7f * size, 0.15f * size},
           base + Vec3{0.38f * size, 0.8f * size, 0.1f * size}},
          0.05f * size, material);
}

void plant(WorldBuilder& s, Vec3 base, float size) {
  Draw& draw = s.draw();
  const int clay = s.material(paints::plaster({0.66f, 0.36f, 0.24f}, s.noise_seed()));
  s.tube(base, base + Vec3{0, 0.45f * size, 0}, 0.2f * size, 0.28f * size, clay);
  s.tube(base + Vec3{0, 0.4f * size, 0}, base + Vec3{0, 0.5f * size, 0}, 0.3f * size, 0.3f * size,
         clay);
  s.disc(base + Vec3{0, 0.46f * size, 0}, {0.28f * size, 0, 0}, {0, 0, 0.28f * size},
         s.plain({0.16f, 0.1f, 0.07f}));
  const int leaves[] = {
      s.cutout(paints::leaf({0.42f, 0.62f, 0.24f}, {0.16f, 0.36f, 0.12f}, s.noise_seed())),
      s.cutout(paints::leaf({0.55f, 0.68f, 0.3f}, {0.25f, 0.42f, 0.16f}, s.noise_seed())),
      s.cutout(paints::fern({0.35f, 0.58f, 0.26f}, {0.14f, 0.32f, 0.12f}, s.noise_seed()))};
  const int stem = s.plain({0.3f, 0.42f, 0.18f});
  for (int i = 0; i < 16; ++i) {
    const float angle = 6.28f * static_cast<float>(i) / 16 + draw.range(-0.3f, 0.3f);
    const float reach = draw.range(0.15f, 0.55f) * size, rise = draw.range(0.25f, 0.75f) * size;
    const Vec3 out{std::cos(angle), 0, std::sin(angle)};
    const Vec3 from = base + Vec3{0, 0.46f * size, 0}, tip = from + out * reach + Vec3{0, rise, 0};
    s.tube(from, tip, 0.012f * size, 0.008f * size, stem);
    const Vec3 along = normalized(out * 0.8f + Vec3{0, draw.range(-0.4f, 0.5f), 0});
    const Vec3 across = normalized(cross(along, Vec3{0.2f, 1, 0.3f}));
    const float length = draw.range(0.3f, 0.48f) * size, width = 0.5f * length;
    s.quad(tip - across * (width / 2) + along * length, across * width, -along * length,
           leaves[i % 3]);
  }
}

void tin(WorldBuilder& s, Vec3 base, float radius, float height) {
  Draw& draw = s.draw();
  // The label goes around twice, and tubes' textures run upwards where canvases run downwards.
  Canvas print =
      paints::label(paints::word(draw), paints::color(draw), paints::color(draw), s.noise_seed());
  Canvas turned(print.width(), print.height(), {});
  turned.shade([&](float u, float v, Rgb) {
    const float x = u * 2 - static_cast<float>(u >= 0.5f);
    return print.color(static_cast<int>((1 - x) * 255.5f), static_cast<int>((1 - v) * 255.5f));
  });
  const int steel = s.material(paints::metal({0.75f, 0.75f, 0.76f}, s.noise_seed()));
  s.tube(base, base + Vec3{0, height, 0}, radius, radius, s.material(turned), steel);
  for (float y : {0.02f, 0.98f}) {
    const Vec3 rim = base + Vec3{0, y * height - 0.005f, 0};
    s.tube(rim, rim + Vec3{0, 0.012f, 0}, radius * 1.03f, radius * 1.03f, steel);
  }
}

void parcel(WorldBuilder& s, Vec3 base, Vec3 size, float yaw) {
  Draw& draw = s.draw();
  const uint32_t seed = s.noise_seed();
  const Rgb card = mix({0.72f, 0.56f, 0.38f}, {0.8f, 0.68f, 0.5f}, draw.range(0, 1));
  Canvas front(256, 256, card);
  front.mottle(20, 0.1f, seed).rect(0.44f, 0, 0.56f, 1, {0.82f, 0.74f, 0.55f});
  front.rect(0.08f, 0.3f, 0.62f, 0.75f, {0.93f, 0.92f, 0.88f});
  front.text(paints::word(draw), 0.11f, 0.34f, 0.09f, {0.1f, 0.1f, 0.1f});
  front.text("NO " + std::to_string(100 + draw.pick(900)), 0.11f, 0.48f, 0.07f, {0.1f, 0.1f, 0.1f});
  for (float x = 0.11f; x < 0.55f; x += 0.014f) {
    if (draw.pick(2)) front.rect(x, 0.6f, x + 0.014f, 0.71f, {0.1f, 0.1f, 0.1f});
  }
  Canvas side(256, 256, card);
  side.mottle(20, 0.1f, seed + 1).rect(0, 0.44f, 1, 0.56f, {0.82f, 0.74f, 0.55f});
  const int plain_side = s.material(side);
  s.box(base, size, {s.material(front), plain_side, plain_side}, yaw);
}

void desk_lamp(WorldBuilder& s, Vec3 base) {
  const int dark = s.material(paints::metal({0.2f, 0.22f, 0.26f}, s.noise_seed()));
  const int red = s.material(paints::metal({0.75f, 0.2f, 0.14f}, s.noise_seed()));
  s.tube(base, base + Vec3{0, 0.03f, 0}, 0.12f, 0.11f, dark, dark);
  const Vec3 elbow = base + Vec3{-0.12f, 0.42f, 0}, head = base + Vec3{0.14f, 0.66f, 0.08f};
  s.tube(base + Vec3{0, 0.03f, 0}, elbow, 0.012f, 0.012f, dark);
  s.ball(elbow, 0.028f, red);
  s.tube(elbow, head, 0.012f, 0.012f, dark);
  s.tube(elbow + Vec3{0, 0.04f, 0}, head + Vec3{0, 0.04f, 0}, 0.005f, 0.005f, dark);
  const Vec3 shade_end = head + Vec3{0.08f, -0.12f, 0.04f};
  s.tube(head, shade_end, 0.035f, 0.12f, red);
  Canvas bulb(4, 4, {1.0f, 0.93f, 0.75f});
  s.ball(shade_end + Vec3{-0.02f, 0.02f, -0.01f}, 0.045f, s.material(bulb, 1.6f));
  s.lamp(shade_end + Vec3{0.03f, -0.06f, 0.02f}, {0.16f, 0.14f, 0.1f}, 0.05f);
}

void pencils(WorldBuilder& s, Vec3 base) {
  Draw& draw = s.draw();
  const int cup = s.material(paints::basket({0.5f, 0.52f, 0.56f}, {0.2f, 0.22f, 0.25f}, 10));
  s.tube(base, base + Vec3{0, 0.13f, 0}, 0.05f, 0.055f, cup);
  for (int i = 0; i < 7; ++i) {
    const float a = draw.range(0, 6.28f), r = draw.range(0.01f, 0.035f);
    const Vec3 foot = base + Vec3{r * std::cos(a), 0.02f, r * std::sin(a)};
    const Vec3 tip =
        foot + Vec3{2 * r * std::cos(a), draw.range(0.18f, 0.25f), 2 * r * std::sin(a)};
    s.tube(foot, tip, 0.007f, 0.007f, s.plain(paints::color(draw)));
    s.tube(tip, tip + (tip - foot) * 0.1f, 0.007f, 0.001f, s.plain({0.85f, 0.7f, 0.5f}));
  }
}

}  // namespace jade::world::worlds
