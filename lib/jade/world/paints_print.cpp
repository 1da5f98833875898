// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "jade/world/paints.h"

namespace jade::world::paints {
namespace {

constexpr Rgb kInk{0.08f, 0.08f, 0.1f};
constexpr Rgb kPaper{0.92f, 0.9f, 0.84f};

std::string sentence(Draw& draw, int letters) {
  std::string text;
  while (static_cast<int>(text.size()) < letters) {
    text += word(draw) + " ";
  }
  return text.substr(0, static_cast<size_t>(letters));
}

void shapes(Canvas& canvas, Draw& draw, int count) {
  for (int i = 0; i < count; ++i) {
    const float x = draw.range(0.1f, 0.9f), y = draw.range(0.1f, 0.9f);
    const float w = draw.range(0.05f, 0.3f), h = draw.range(0.05f, 0.3f);
    const Rgb c = color(draw);
    switch (draw.pick(3)) {
      case 0:
        canvas.ellipse(x, y, w, w, c);
        break;
      case 1:
        canvas.rect(x - w, y - h, x + w, y + h, c);
        break;
      default:
        canvas.line(x - w, y - h, x + w, y + h, draw.range(0.01f, 0.06f), c);
    }
  }
}

}  // namespace

std::string word(Draw& draw) {
  static const char* const kWords[] = {
      "ORBIT",  "VECTOR", "HONEY",  "PRISM",  "DELTA",   "TEA",    "ATLAS",  "RIVER",  "SALT",
      "CEDAR",  "MOSS",   "PIXEL",  "LEMON",  "GRAVITY", "NORTH",  "QUARTZ", "EVENT",  "SHARP",
      "LIGHT",  "PEPPER", "MODEL",  "ISLAND", "COPPER",  "RADIO",  "MOTION", "FIELD",  "GARDEN",
      "OPTICS", "BREAD",  "STUDIO", "KERNEL", "SIGNAL",  "FOREST", "MATRIX", "COFFEE", "HARBOR"};
  return kWords[draw.pick(36)];
}

Rgb color(Draw& draw) {
  static constexpr Rgb kPalette[] = {
      {0.78f, 0.22f, 0.18f}, {0.16f, 0.36f, 0.6f}, {0.9f, 0.68f, 0.2f},   {0.22f, 0.52f, 0.34f},
      {0.5f, 0.28f, 0.52f},  {0.88f, 0.46f, 0.2f}, {0.2f, 0.56f, 0.6f},   {0.86f, 0.82f, 0.72f},
      {0.2f, 0.2f, 0.26f},   {0.66f, 0.34f, 0.3f}, {0.46f, 0.62f, 0.28f}, {0.84f, 0.56f, 0.6f}};
  const Rgb base = kPalette[draw.pick(12)];
  return base * draw.range(0.8f, 1.15f);
}

Canvas page(uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(384, 512, kPaper);
  canvas.text(sentence(draw, 11), 0.08f, 0.05f, 0.07f, kInk);
  canvas.line(0.08f, 0.145f, 0.92f, 0.145f, 0.006f, kInk);
  const float picture = draw.range(0.2f, 0.45f);
  canvas.rect(0.54f, picture, 0.92f, picture + 0.22f, color(draw));
  canvas.ellipse(0.72f, picture + 0.11f, 0.1f, 0.08f, color(draw));
  for (int column = 0; column < 2; ++column) {
    for (float y = 0.18f; y < 0.93f; y += 0.034f) {
      if (column == 1 && y > picture - 0.03f && y < picture + 0.23f) continue;
      canvas.text(sentence(draw, 19 - draw.pick(4)), 0.08f + 0.46f * static_cast<float>(column), y,
                  0.02f, kInk * 2.0f);
    }
  }
  return canvas;
}

Canvas poster(const std::string& title, uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(384, 512, color(draw));
  shapes(canvas, draw, 9);
  canvas.rect(0.0f, 0.76f, 1.0f, 1.0f, kPaper);
  const float size = std::min(0.12f, 0.62f / Canvas::text_width(title));
  canvas.text(title, 0.07f, 0.79f, size, kInk);
  canvas.text(sentence(draw, 22), 0.07f, 0.93f, 0.03f, kInk);
  return canvas.frame(0, 0, 1, 1, 0.025f, kPaper * 0.95f);
}

Canvas painting(uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(512, 384, color(draw));
  const Rgb a = color(draw), b = color(draw), c = color(draw);
  canvas.shade([&](float u, float v, Rgb) {
    const float n = fractal_noise(u * 4, v * 3, seed, 5);
    const float m = fractal_noise(u * 9 + 4 * n, v * 7 + 4 * n, seed + 3, 4);
    return mix(mix(a, b, std::clamp(3 * n - 1, 0.0f, 1.0f)), c,
               std::clamp(4 * m - 1.8f, 0.0f, 1.0f));
  });
  shapes(canvas, draw, 5);
  canvas.mottle(90, 0.12f, seed + 5);
  canvas.frame(0, 0, 1, 1, 0.05f, {0.5f, 0.36f, 0.16f});
  return canvas.frame(0.02f, 0.027f, 0.98f, 0.973f, 0.01f, {0.75f, 0.6f, 0.32f});
}

Canvas label(const std::string& title, Rgb ground, Rgb band, uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(256, 256, ground);
  canvas.rect(0, 0.16f, 1, 0.44f, band);
  const float size = std::min(0.2f, 0.88f / Canvas::text_width(title));
  canvas.text(title, 0.06f, 0.3f - size / 2, size, kPaper);
  canvas.ellipse(0.76f, 0.68f, 0.15f, 0.15f, color(draw));
  canvas.ellipse(0.76f, 0.68f, 0.08f, 0.08f, band);
  for (float y = 0.5f; y < 0.72f; y += 0.055f) {
    canvas.text(sentence(draw, 12), 0.06f, y, 0.035f, kInk);
  }
  for (float x = 0.06f; x < 0.5f; x += 0.012f) {  // bar code
    if (draw.pick(2)) canvas.rect(x, 0.78f, x + 0.012f, 0.94f, kInk);
  }
  return canvas;
}

Canvas spine(const std::string& title, Rgb cover, Rgb ink, uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(64, 384, cover);
  canvas.mottle(30, 0.08f, seed);
  canvas.rect(0, 0.06f, 1, 0.08f, ink).rect(0, 0.09f, 1, 0.1f, ink);
  canvas.rect(0, 0.9f, 1, 0.93f, ink);
  const float letters = static_cast<float>(title.size());
  const float size = std::min(0.6f, 0.74f * 384 / 64 / (letters * 6 / 7));
  canvas.text_down(title, 0.5f - size / 2, 0.14f, size, ink);
  return canvas;
}

Canvas crate(const std::string& title, uint32_t seed) {
  Canvas canvas = planks({0.72f, 0.56f, 0.36f}, {0.5f, 0.35f, 0.2f}, 5, seed);
  canvas.frame(0, 0, 1, 1, 0.08f, {0.58f, 0.42f, 0.25f});
  const float size = std::min(0.2f, 0.7f / Canvas::text_width(title));
  canvas.text(title, 0.15f, 0.42f, size, {0.2f, 0.12f, 0.08f});
  for (float x : {0.04f, 0.96f}) {
    for (float y = 0.1f; y < 1; y += 0.2f) canvas.ellipse(x, y, 0.012f, 0.012f, {0.2f, 0.2f, 0.2f});
  }
  return canvas;
}

Canvas screen(uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(512, 320, {0.07f, 0.09f, 0.13f});
  canvas.rect(0, 0, 1, 0.06f, {0.25f, 0.27f, 0.32f}).rect(0, 0.06f, 0.16f, 1, {0.12f, 0.14f, 0.2f});
  for (int line = 0; line < 21; ++line) {
    const float y = 0.09f + 0.043f * static_cast<float>(line);
    float x = 0.2f + 0.03f * static_cast<float>(draw.pick(4));
    canvas.text(word(draw), 0.02f, y, 0.022f, {0.5f, 0.55f, 0.62f});
    for (int i = draw.pick(4); i >= 0 && x < 0.85f; --i) {
      const std::string w = word(draw);
      canvas.text(w, x, y, 0.028f, mix(color(draw), {0.9f, 0.92f, 0.95f}, 0.45f));
      x += Canvas::text_width(w) * 0.028f * 320 / 512 + 0.02f;
    }
  }
  return canvas;
}

Canvas keyboard() {
  Canvas canvas(512, 192, {0.16f, 0.16f, 0.18f});
  const std::string keys[] = {"1234567890-", "QWERTYUIOP+", "ASDFGHJKL#:", "ZXCVBNM.-/%"};
  for (size_t row = 0; row < 4; ++row) {
    for (size_t i = 0; i < 11; ++i) {
      const float x = 0.02f + 0.087f * static_cast<float>(i),
                  y = 0.05f + 0.19f * static_cast<float>(row);
      canvas.rect(x, y, x + 0.075f, y + 0.16f, {0.82f, 0.82f, 0.8f});
      canvas.text(keys[row].substr(i, 1), x + 0.02f, y + 0.04f, 0.09f, kInk);
    }
  }
  return canvas.rect(0.25f, 0.83f, 0.7f, 0.95f, {0.82f, 0.82f, 0.8f});
}

Canvas clock_face(uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(256, 256, kPaper);
  canvas.ellipse(0.5f, 0.5f, 0.5f, 0.5f, color(draw)).ellipse(0.5f, 0.5f, 0.43f, 0.43f, kPaper);
  for (int i = 0; i < 60; ++i) {
    const float a = 6.2831853f * static_cast<float>(i) / 60, s = std::sin(a), c = std::cos(a);
    const float inner = i % 5 ? 0.39f : 0.35f;
    canvas.line(0.5f + inner * s, 0.5f - inner * c, 0.5f + 0.42f * s, 0.5f - 0.42f * c,
                i % 5 ? 0.006f : 0.016f, kInk);
  }
  const float hour = draw.range(0, 6.28f), minute = draw.range(0, 6.28f);
  canvas.line(0.5f, 0.5f, 0.5f + 0.2f * std::sin(hour), 0.5f - 0.2f * std::cos(hour), 0.03f, kInk);
  return canvas.line(0.5f, 0.5f, 0.5f + 0.33f * std::sin(minute), 0.5f - 0.33f * std::cos(minute),
                     0.018f, kInk);
}

Canvas calendar(uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(320, 384, kPaper);
  canvas.rect(0, 0, 1, 0.3f, color(draw));
  shapes(canvas, draw, 3);
  canvas.rect(0, 0.3f, 1, 1, kPaper).text(word(draw), 0.08f, 0.33f, 0.07f, {0.7f, 0.15f, 0.12f});
  for (int day = 1; day <= 31; ++day) {
    const float x = 0.06f + 0.13f * static_cast<float>((day + 2) % 7);
    const float y = 0.44f + 0.09f * static_cast<float>((day + 2) / 7);
    canvas.text(std::to_string(day), x, y, 0.045f, kInk);
    canvas.frame(x - 0.02f, y - 0.02f, x + 0.1f, y + 0.065f, 0.004f, {0.6f, 0.6f, 0.58f});
  }
  return canvas;
}

Canvas circuit(uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(512, 512, {0.07f, 0.3f, 0.16f});
  for (int i = 0; i < 90; ++i) {
    const float x = draw.range(0, 1), y = draw.range(0, 1), l = draw.range(0.05f, 0.3f);
    const bool flat = draw.pick(2);
    const Rgb copper{0.25f, 0.52f, 0.25f};
    canvas.line(x, y, flat ? x + l : x, flat ? y : y + l, 0.005f, copper);
    canvas.ellipse(x, y, 0.009f, 0.009f, {0.8f, 0.75f, 0.55f});
  }
  for (int i = 0; i < 14; ++i) {
    const float x = draw.range(0.03f, 0.8f), y = draw.range(0.03f, 0.85f);
    const float w = draw.range(0.05f, 0.18f), h = draw.range(0.04f, 0.13f);
    for (float p = x + 0.008f; p < x + w; p += 0.02f) {
      canvas.rect(p, y - 0.018f, p + 0.009f, y + h + 0.018f, {0.8f, 0.8f, 0.78f});
    }
    canvas.rect(x, y, x + w, y + h, kInk);
    canvas.text(word(draw), x + 0.012f, y + 0.01f, 0.02f, kPaper);
  }
  return canvas;
}

Canvas ruler() {
  Canvas canvas(512, 48, {0.92f, 0.8f, 0.3f});
  for (int i = 0; i <= 60; ++i) {
    const float x = 0.01f + 0.98f * static_cast<float>(i) / 60;
    canvas.rect(x, 0, x + 0.003f, i % 10 ? (i % 5 ? 0.25f : 0.4f) : 0.55f, kInk);
    if (i % 10 == 0) canvas.text(std::to_string(i / 2), x + 0.006f, 0.6f, 0.32f, kInk);
  }
  return canvas;
}

Canvas map_sheet(uint32_t seed) {
  Draw draw(seed);
  Canvas canvas(512, 384, {0.6f, 0.78f, 0.86f});
  canvas.shade([=](float u, float v, Rgb old) {
    const float n = fractal_noise(u * 5, v * 4, seed, 6);
    if (n < 0.5f) return n > 0.49f ? Rgb{0.3f, 0.45f, 0.55f} : old;
    const float level = std::floor((n - 0.5f) * 30) / 8;
    return mix({0.7f, 0.78f, 0.5f}, {0.75f, 0.55f, 0.35f}, std::min(level, 1.0f));
  });
  for (int i = 1; i < 8; ++i) {
    const float x = static_cast<float>(i) / 8;
    canvas.line(x, 0, x, 1, 0.002f, {0.35f, 0.4f, 0.45f})
        .line(0, x, 1, x, 0.002f, {0.35f, 0.4f, 0.45f});
  }
  for (int i = 0; i < 12; ++i) {
    const float x = draw.range(0.05f, 0.8f), y = draw.range(0.05f, 0.9f);
    canvas.ellipse(x, y, 0.008f, 0.01f, {0.7f, 0.1f, 0.1f});
    canvas.text(word(draw), x + 0.015f, y - 0.015f, 0.035f, kInk);
  }
  return canvas.frame(0, 0, 1, 1, 0.02f, kPaper);
}

}  // namespace jade::world::paints
