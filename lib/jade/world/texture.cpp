// SPDX-License-Identifier: Apache-2.0
#include "jade/world/texture.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace jade::world {
namespace {

uint8_t to_byte(float v) {
  return static_cast<uint8_t>(std::lround(std::clamp(v, 0.0f, 1.0f) * 255));
}

/// log2 of a positive number from its exponent bits and a parabola: within 0.01.
float fast_log2(float v) {
  uint32_t bits;
  std::memcpy(&bits, &v, sizeof bits);
  const auto exponent = static_cast<float>(static_cast<int>(bits >> 23) - 127);
  bits = (bits & 0x007FFFFFu) | 0x3F800000u;
  float m;  // in [1,2)
  std::memcpy(&m, &bits, sizeof m);
  return exponent + (2 - m * (1.0f / 3)) * m - 5.0f / 3;
}

// For indices that are at most one period out of range.
int wrap(int i, int n) { return i < 0 ? i + n : i >= n ? i - n : i; }

}  // namespace

Texture::Texture(const Canvas& canvas) {
  Level base{canvas.width(), canvas.height(), {}};
  base.rgba.reserve(static_cast<size_t>(base.width) * static_cast<size_t>(base.height) * 4);
  for (int y = 0; y < base.height; ++y) {
    for (int x = 0; x < base.width; ++x) {
      const Rgb c = canvas.color(x, y);
      for (float v : {c.r, c.g, c.b, canvas.alpha(x, y)}) {
        base.rgba.push_back(to_byte(v));
      }
    }
  }
  levels_.push_back(std::move(base));
  while (levels_.back().width > 1 || levels_.back().height > 1) {
    const Level& fine = levels_.back();
    Level half{std::max(1, fine.width / 2), std::max(1, fine.height / 2), {}};
    half.rgba.resize(static_cast<size_t>(half.width) * static_cast<size_t>(half.height) * 4);
    for (int y = 0; y < half.height; ++y) {
      const int y0 = std::min(2 * y, fine.height - 1), y1 = std::min(2 * y + 1, fine.height - 1);
      for (int x = 0; x < half.width; ++x) {
        const int x0 = std::min(2 * x, fine.width - 1), x1 = std::min(2 * x + 1, fine.width - 1);
        for (int c = 0; c < 4; ++c) {
          const auto at = [&](int px, int py) {
            return fine.rgba[static_cast<size_t>((py * fine.width + px) * 4 + c)];
          };
          const int sum = at(x0, y0) + at(x1, y0) + at(x0, y1) + at(x1, y1);
          half.rgba[static_cast<size_t>((y * half.width + x) * 4 + c)] =
              static_cast<uint8_t>((sum + 2) / 4);
        }
      }
    }
    levels_.push_back(std::move(half));
  }
}

Texture::Blend Texture::blend(float footprint) const {
  const float texels = footprint * static_cast<float>(levels_[0].width);
  const float top = static_cast<float>(levels_.size() - 1);
  const float lod = texels <= 1 ? 0.0f : std::min(std::max(fast_log2(texels), 0.0f), top);
  const int level = std::min(static_cast<int>(lod), static_cast<int>(levels_.size()) - 1);
  return {level, lod - static_cast<float>(level)};
}

void Texture::lookup(const Level& level, float u, float v, float rgba[4]) {
  const float x = (u - static_cast<float>(floor_int(u))) * static_cast<float>(level.width) - 0.5f;
  const float y = (v - static_cast<float>(floor_int(v))) * static_cast<float>(level.height) - 0.5f;
  const int ix = floor_int(x), iy = floor_int(y);
  const int x0 = wrap(ix, level.width), x1 = x0 + 1 == level.width ? 0 : x0 + 1;
  const int y0 = wrap(iy, level.height), y1 = y0 + 1 == level.height ? 0 : y0 + 1;
  const float ax = x - static_cast<float>(ix), ay = y - static_cast<float>(iy);
  const float weight[4] = {(1 - ax) * (1 - ay), ax * (1 - ay), (1 - ax) * ay, ax * ay};
  const uint8_t* texels = level.rgba.data();
  const uint8_t* corner[4] = {
      texels + 4 * (y0 * level.width + x0), texels + 4 * (y0 * level.width + x1),
      texels + 4 * (y1 * level.width + x0), texels + 4 * (y1 * level.width + x1)};
  for (int c = 0; c < 4; ++c) {
    rgba[c] = (weight[0] * corner[0][c] + weight[1] * corner[1][c] + weight[2] * corner[2][c] +
               weight[3] * corner[3][c]) *
              (1.0f / 255);
  }
}

Rgb Texture::sample(float u, float v, float footprint) const {
  const Blend at = blend(footprint);
  float fine[4], coarse[4];
  lookup(levels_[static_cast<size_t>(at.level)], u, v, fine);
  if (at.fraction <= 0) {
    return {fine[0], fine[1], fine[2]};
  }
  lookup(levels_[static_cast<size_t>(at.level) + 1], u, v, coarse);
  return mix({fine[0], fine[1], fine[2]}, {coarse[0], coarse[1], coarse[2]}, at.fraction);
}

float Texture::opacity(float u, float v, float footprint) const {
  float rgba[4];
  lookup(levels_[static_cast<size_t>(blend(footprint).level)], u, v, rgba);
  return rgba[3];
}

}  // namespace jade::world
