// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "jade/world/paints.h"

namespace jade::world::paints {
namespace {

constexpr int kSize = 512;

float fraction(float v) { return v - std::floor(v); }
float cell_random(int x, int y, uint32_t seed) {
  return value_noise(static_cast<float>(x), static_cast<float>(y), seed);
}
int modulo(int a, int n) { return ((a % n) + n) % n; }

/// Distances to the nearest and second nearest of one random point per cell (Worley), periodic.
struct Cells {
  float nearest, second;
  float tint;
};
Cells cells_at(float x, float y, int period, uint32_t seed) {
  Cells found{9, 9, 0};
  const int cx = static_cast<int>(std::floor(x)), cy = static_cast<int>(std::floor(y));
  for (int j = cy - 1; j <= cy + 1; ++j) {
    for (int i = cx - 1; i <= cx + 1; ++i) {
      const int wi = modulo(i, period), wj = modulo(j, period);
      const float px = static_cast<float>(i) + 0.15f + 0.7f * cell_random(wi, wj, seed);
      const float py = static_cast<float>(j) + 0.15f + 0.7f * cell_random(wi, wj, seed + 7);
      const float d = std::hypot(px - x, py - y);
      if (d < found.nearest) {
        found = {d, found.nearest, cell_random(wi, wj, seed + 13)};
      } else {
        found.second = std::min(found.second, d);
      }
    }
  }
  return found;
}

}  // namespace

Canvas wood(Rgb light, Rgb dark, float rings, uint32_t seed) {
  Canvas canvas(kSize, kSize, light);
  return canvas.shade([=](float u, float v, Rgb) {
    const float bend = fractal_noise(u * 1.5f, v * 4, seed, 4);
    const float ring = fraction(v * rings + 2.2f * bend);
    const float grain = value_noise(u * 12, v * 260, seed + 5);
    const float t = 0.65f * ring * ring + 0.35f * grain;
    return mix(light, dark, std::clamp(t, 0.0f, 1.0f));
  });
}

Canvas planks(Rgb light, Rgb dark, int rows, uint32_t seed) {
  Canvas canvas(kSize, kSize, light);
  return canvas.shade([=](float u, float v, Rgb) {
    const float y = v * static_cast<float>(rows);
    const int row = static_cast<int>(y);
    const float shift = cell_random(row, 3, seed), x = u + shift;
    const float in_row = fraction(y), along = fraction(x);
    if (in_row < 0.035f || along < 0.006f) return dark * 0.35f;
    const auto board = seed + static_cast<uint32_t>(row) * 17u;
    const float grain = value_noise(along * 10, in_row * 40, board, 10);
    const float waves = fractal_noise(along * 4, in_row * 2, board + 3, 4, 4);
    const float tone = 0.75f + 0.5f * cell_random(row, 9, seed);
    return mix(light, dark, std::clamp(0.4f * grain + 0.8f * waves - 0.1f, 0.0f, 1.0f)) * tone;
  });
}

Canvas marble(Rgb base, Rgb vein, uint32_t seed) {
  Canvas canvas(kSize, kSize, base);
  return canvas.shade([=](float u, float v, Rgb) {
    const float warp = fractal_noise(u * 5, v * 5, seed, 5);
    const float wave = std::abs(std::sin(9 * u + 6 * v + 9 * warp));
    const float fine = fractal_noise(u * 30, v * 30, seed + 2, 3);
    return mix(vein, base, std::clamp(std::pow(wave, 0.45f), 0.0f, 1.0f)) * (0.88f + 0.24f * fine);
  });
}

Canvas bricks(Rgb brick, Rgb mortar, int rows, uint32_t seed) {
  Canvas canvas(kSize, kSize, mortar);
  const int columns = std::max(1, rows / 2);
  return canvas.shade([=](float u, float v, Rgb) {
    const float y = v * static_cast<float>(rows);
    const int row = static_cast<int>(y);
    const float x = u * static_cast<float>(columns) + 0.5f * static_cast<float>(row % 2);
    const int column = modulo(static_cast<int>(x), columns);
    const float rough = fractal_noise(u * 64, v * 64, seed, 3, 64);
    const float ragged = 0.03f * (rough - 0.5f);
    const float fx = fraction(x), fy = fraction(y);
    if (fx < 0.045f + ragged || fy < 0.11f + 2 * ragged) return mortar * (0.75f + 0.5f * rough);
    const float tone = 0.6f + 0.7f * cell_random(column, row, seed + 1);
    const Rgb warm = mix(brick, {brick.r * 0.8f, brick.g * 1.1f, brick.b * 1.2f},
                         cell_random(column, row, seed + 2));
    return warm * (tone * (0.7f + 0.6f * rough));
  });
}

Canvas cobbles(Rgb stone, Rgb joint, int cells, uint32_t seed) {
  Canvas canvas(kSize, kSize, stone);
  return canvas.shade([=](float u, float v, Rgb) {
    const Cells c =
        cells_at(u * static_cast<float>(cells), v * static_cast<float>(cells), cells, seed);
    const float rough = fractal_noise(u * 48, v * 48, seed + 4, 3, 48);
    if (c.second - c.nearest < 0.09f) return joint * (0.6f + 0.8f * rough);
    return stone * ((0.55f + 0.75f * c.tint) * (0.75f + 0.5f * rough) * (1.1f - 0.35f * c.nearest));
  });
}

Canvas tiles(Rgb a, Rgb b, Rgb grout, int cells, uint32_t seed) {
  Canvas canvas(kSize, kSize, a);
  return canvas.shade([=](float u, float v, Rgb) {
    const float x = u * static_cast<float>(cells), y = v * static_cast<float>(cells);
    const int i = static_cast<int>(x), j = static_cast<int>(y);
    if (fraction(x) < 0.03f || fraction(y) < 0.03f) return grout;
    const float rough = fractal_noise(u * 20, v * 20, seed, 4, 20);
    const float tone = 0.85f + 0.3f * cell_random(i, j, seed + 1);
    return ((i + j) % 2 ? a : b) * (tone * (0.85f + 0.3f * rough));
  });
}

Canvas checker(Rgb a, Rgb b, int cells, uint32_t seed) {
  Canvas canvas(kSize, kSize, a);
  return canvas.shade([=](float u, float v, Rgb) {
    const float n = static_cast<float>(cells);
    const int i = static_cast<int>(u * n), j = static_cast<int>(v * n);
    const int scale = 1 << (2 * static_cast<int>(2.99f * cell_random(i / 2, j / 2, seed)));
    const auto s = static_cast<float>(scale);
    const int fine = static_cast<int>(u * n * s) + static_cast<int>(v * n * s);
    return fine % 2 ? a : b;
  });
}

Canvas plaster(Rgb color, uint32_t seed) {
  return Canvas(kSize, kSize, color).mottle(5, 0.12f, seed).mottle(70, 0.07f, seed + 1);
}

Canvas concrete(uint32_t seed) {
  Canvas canvas = Canvas(kSize, kSize, {0.55f, 0.55f, 0.53f}).mottle(6, 0.25f, seed);
  canvas.mottle(120, 0.25f, seed + 1);
  Draw draw(seed);
  for (int i = 0; i < 6; ++i) {
    float x = draw.range(0, 1), y = draw.range(0, 1);
    for (int k = 0; k < 12; ++k) {
      const float nx = x + draw.range(-0.05f, 0.05f), ny = y + draw.range(0, 0.06f);
      canvas.line(x, y, nx, ny, 0.004f, {0.25f, 0.25f, 0.24f});
      x = nx, y = ny;
    }
  }
  return canvas;
}

Canvas fabric(Rgb a, Rgb b, Rgb thread, int bands, uint32_t seed) {
  Canvas canvas(kSize, kSize, a);
  return canvas.shade([=](float u, float v, Rgb) {
    const auto n = static_cast<float>(bands);
    const float s = fraction(u * n), t = fraction(v * n);
    Rgb c = mix(a, b, 0.5f * static_cast<float>(s < 0.4f) + 0.5f * static_cast<float>(t < 0.4f));
    if (std::abs(s - 0.7f) < 0.035f || std::abs(t - 0.7f) < 0.035f) c = thread;
    const int weave = (static_cast<int>(u * 128) + static_cast<int>(v * 128)) % 2;
    return c * (0.85f + 0.15f * static_cast<float>(weave)) *
           (0.9f + 0.2f * value_noise(u * 90, v * 90, seed));
  });
}

Canvas carpet(Rgb a, Rgb b, Rgb c, uint32_t seed) {
  Canvas canvas(kSize, kSize, a);
  return canvas.shade([=](float u, float v, Rgb) {
    const float x = std::abs(u - 0.5f) * 2, y = std::abs(v - 0.5f) * 2;
    const float edge = std::max(x, y), diamond = fraction(6 * (x + y)), zig = fraction(8 * (x - y));
    Rgb color = diamond < 0.3f ? b : zig < 0.2f ? c : a;
    if (edge > 0.86f) color = fraction(16 * (u + v)) < 0.5f ? c : b;
    if (edge > 0.95f) color = a * 0.5f;
    return color * (0.7f + 0.6f * value_noise(u * 200, v * 200, seed));
  });
}

Canvas stripes(Rgb a, Rgb b, int count, bool upright) {
  Canvas canvas(256, 256, a);
  return canvas.shade([=](float u, float v, Rgb) {
    return static_cast<int>((upright ? u : v) * 2 * static_cast<float>(count)) % 2 ? a : b;
  });
}

Canvas metal(Rgb color, uint32_t seed) {
  Canvas canvas(256, 256, color);
  return canvas.shade([=](float u, float v, Rgb old) {
    return old * (0.8f + 0.25f * value_noise(u * 4, v * 180, seed) +
                  0.2f * fractal_noise(u * 6, v * 6, seed + 1, 4));
  });
}

Canvas rust(uint32_t seed) {
  Canvas canvas(256, 256, {0.4f, 0.42f, 0.44f});
  return canvas.shade([=](float u, float v, Rgb old) {
    const float n = fractal_noise(u * 7, v * 7, seed, 6, 7);
    const float fine = fractal_noise(u * 40, v * 40, seed + 1, 3, 40);
    const Rgb stain = mix({0.5f, 0.24f, 0.1f}, {0.28f, 0.12f, 0.06f}, fine);
    return n > 0.5f ? stain : old * (0.7f + 0.6f * fine);
  });
}

Canvas grass(uint32_t seed) {
  Canvas canvas = Canvas(kSize, kSize, {0.2f, 0.3f, 0.1f}).mottle(8, 0.4f, seed);
  Draw draw(seed);
  for (int i = 0; i < 5000; ++i) {
    const float x = draw.range(0, 1), y = draw.range(0, 1), lean = draw.range(-0.012f, 0.012f);
    const Rgb blade = mix({0.16f, 0.3f, 0.07f}, {0.55f, 0.66f, 0.25f}, draw.range(0, 1));
    canvas.line(x, y, x + lean, y - draw.range(0.012f, 0.035f), 0.003f, blade);
  }
  return canvas;
}

Canvas gravel(uint32_t seed) {
  return cobbles({0.62f, 0.58f, 0.52f}, {0.25f, 0.23f, 0.2f}, 26, seed);
}

Canvas foliage(Rgb light, Rgb dark, uint32_t seed) {
  Canvas canvas(kSize, kSize, dark * 0.5f);
  Draw draw(seed);
  for (int i = 0; i < 1400; ++i) {
    const float x = draw.range(0, 1), y = draw.range(0, 1), angle = draw.range(0, 6.28f);
    const float size = draw.range(0.012f, 0.03f);
    const Rgb tone = mix(dark, light, draw.range(0, 1));
    const float dx = std::cos(angle) * size, dy = std::sin(angle) * size;
    canvas.line(x - dx, y - dy, x + dx, y + dy, 0.6f * size, tone);
    canvas.line(x - dx, y - dy, x + dx, y + dy, 0.003f, tone * 0.65f);
  }
  return canvas;
}

Canvas basket(Rgb light, Rgb dark, int cells) {
  Canvas canvas(256, 256, light);
  return canvas.shade([=](float u, float v, Rgb) {
    const float x = u * static_cast<float>(cells), y = v * static_cast<float>(cells);
    const bool across = (static_cast<int>(x) + static_cast<int>(y)) % 2;
    const float s = across ? fraction(y) : fraction(x);
    return mix(dark, light, std::sin(3.14159f * s));
  });
}

Canvas pegboard(Rgb color, int cells) {
  Canvas canvas(kSize, kSize, color);
  return canvas.shade([=](float u, float v, Rgb old) {
    const float x = fraction(u * static_cast<float>(cells)) - 0.5f;
    const float y = fraction(v * static_cast<float>(cells)) - 0.5f;
    return x * x + y * y < 0.03f ? old * 0.2f : old;
  });
}

Canvas sky(uint32_t seed) {
  Canvas canvas(kSize, kSize, {0.5f, 0.65f, 0.85f});
  return canvas.shade([=](float u, float v, Rgb) {
    const Rgb blue = mix({0.42f, 0.58f, 0.82f}, {0.78f, 0.84f, 0.88f}, v);
    const float cloud = fractal_noise(u * 5, v * 9, seed, 6);
    return mix(blue, {0.95f, 0.95f, 0.94f}, std::clamp((cloud - 0.48f) * 5, 0.0f, 1.0f));
  });
}

Canvas wire_mesh(Rgb color, int cells, float thickness) {
  Canvas canvas(256, 256, color);
  return canvas.cut([=](float u, float v) {
    const float n = static_cast<float>(cells);
    return fraction(u * n + v * n) < thickness || fraction(u * n - v * n) < thickness;
  });
}

Canvas leaf(Rgb light, Rgb dark, uint32_t seed) {
  Canvas canvas(128, 128, light);
  canvas.shade([=](float u, float v, Rgb) {
    const float vein = fraction(9 * (v + std::abs(u - 0.5f)));
    const Rgb base = mix(dark, light, 0.3f + 0.7f * value_noise(u * 6, v * 6, seed));
    return std::abs(u - 0.5f) < 0.025f || vein < 0.12f ? light * 1.15f : base;
  });
  return canvas.cut([](float u, float v) {
    const float half = 0.48f * std::sin(3.14159f * std::pow(v, 0.8f));
    return std::abs(u - 0.5f) < half;
  });
}

Canvas fern(Rgb light, Rgb dark, uint32_t seed) {
  Canvas canvas(256, 256, light);
  canvas.shade(
      [=](float u, float v, Rgb) { return mix(dark, light, value_noise(u * 20, v * 20, seed)); });
  return canvas.cut([](float u, float v) {
    const float side = std::abs(u - 0.5f);
    const float reach = 0.47f * std::sin(3.14159f * std::pow(v, 0.7f));
    return side < 0.012f || (side < reach && fraction(14 * (v + 0.6f * side)) < 0.55f);
  });
}

Canvas flower(Rgb petal, Rgb heart, int petals) {
  Canvas canvas(128, 128, petal);
  canvas.shade([=](float u, float v, Rgb) {
    const float r = std::hypot(u - 0.5f, v - 0.5f) * 2;
    return r < 0.28f ? heart : mix(heart, petal, std::clamp(2.5f * r - 0.5f, 0.0f, 1.0f));
  });
  return canvas.cut([=](float u, float v) {
    const float x = u - 0.5f, y = v - 0.5f, r = std::hypot(x, y) * 2;
    const float wave = std::abs(std::cos(0.5f * static_cast<float>(petals) * std::atan2(y, x)));
    return r < 0.45f + 0.55f * wave;
  });
}

}  // namespace jade::world::paints
