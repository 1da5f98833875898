// SPDX-License-Identifier: Apache-2.0
#include "jade/world/canvas.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "jade/world/noise.h"

namespace jade::world {
namespace {

struct Glyph {
  char letter;
  std::array<uint8_t, 7> rows;  // five bits each, the leftmost pixel is 16
};

constexpr Glyph kGlyphs[] = {
    {'A', {14, 17, 17, 31, 17, 17, 17}}, {'B', {30, 17, 17, 30, 17, 17, 30}},
    {'C', {14, 17, 16, 16, 16, 17, 14}}, {'D', {30, 17, 17, 17, 17, 17, 30}},
    {'E', {31, 16, 16, 30, 16, 16, 31}}, {'F', {31, 16, 16, 30, 16, 16, 16}},
    {'G', {14, 17, 16, 23, 17, 17, 15}}, {'H', {17, 17, 17, 31, 17, 17, 17}},
    {'I', {14, 4, 4, 4, 4, 4, 14}},      {'J', {7, 2, 2, 2, 2, 18, 12}},
    {'K', {17, 18, 20, 24, 20, 18, 17}}, {'L', {16, 16, 16, 16, 16, 16, 31}},
    {'M', {17, 27, 21, 21, 17, 17, 17}}, {'N', {17, 25, 25, 21, 19, 19, 17}},
    {'O', {14, 17, 17, 17, 17, 17, 14}}, {'P', {30, 17, 17, 30, 16, 16, 16}},
    {'Q', {14, 17, 17, 17, 21, 18, 13}}, {'R', {30, 17, 17, 30, 20, 18, 17}},
    {'S', {15, 16, 16, 14, 1, 1, 30}},   {'T', {31, 4, 4, 4, 4, 4, 4}},
    {'U', {17, 17, 17, 17, 17, 17, 14}}, {'V', {17, 17, 17, 17, 10, 10, 4}},
    {'W', {17, 17, 17, 21, 21, 27, 17}}, {'X', {17, 10, 10, 4, 10, 10, 17}},
    {'Y', {17, 17, 10, 4, 4, 4, 4}},     {'Z', {31, 1, 2, 4, 8, 16, 31}},
    {'0', {14, 17, 19, 21, 25, 17, 14}}, {'1', {4, 12, 4, 4, 4, 4, 14}},
    {'2', {14, 17, 1, 6, 8, 16, 31}},    {'3', {30, 1, 1, 14, 1, 1, 30}},
    {'4', {2, 6, 10, 18, 31, 2, 2}},     {'5', {31, 16, 30, 1, 1, 17, 14}},
    {'6', {14, 16, 16, 30, 17, 17, 14}}, {'7', {31, 1, 2, 4, 4, 8, 8}},
    {'8', {14, 17, 17, 14, 17, 17, 14}}, {'9', {14, 17, 17, 15, 1, 1, 14}},
    {'-', {0, 0, 0, 31, 0, 0, 0}},       {'.', {0, 0, 0, 0, 0, 12, 12}},
    {':', {0, 12, 12, 0, 12, 12, 0}},    {'/', {1, 1, 2, 4, 8, 16, 16}},
    {'+', {0, 4, 4, 31, 4, 4, 0}},       {'&', {12, 18, 20, 8, 21, 18, 13}},
    {'%', {25, 25, 2, 4, 8, 19, 19}},    {'#', {10, 10, 31, 10, 31, 10, 10}},
};

bool glyph_bit(char letter, int column, int row) {
  for (const Glyph& glyph : kGlyphs) {
    if (glyph.letter == letter) {
      return (glyph.rows[static_cast<size_t>(row)] >> (4 - column)) & 1;
    }
  }
  return false;
}

}  // namespace

Canvas::Canvas(int width, int height, Rgb fill)
    : width_(width),
      height_(height),
      color_(static_cast<size_t>(width) * static_cast<size_t>(height), fill),
      alpha_(color_.size(), 1.0f) {}

void Canvas::set(int x, int y, Rgb color) {
  if (x >= 0 && y >= 0 && x < width_ && y < height_) {
    color_[index(x, y)] = color;
  }
}

Canvas& Canvas::shade(const std::function<Rgb(float, float, Rgb)>& paint) {
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const float u = (static_cast<float>(x) + 0.5f) / static_cast<float>(width_);
      const float v = (static_cast<float>(y) + 0.5f) / static_cast<float>(height_);
      color_[index(x, y)] = paint(u, v, color_[index(x, y)]);
    }
  }
  return *this;
}

Canvas& Canvas::rect(float x0, float y0, float x1, float y1, Rgb color) {
  const auto w = static_cast<float>(width_), h = static_cast<float>(height_);
  for (int y = static_cast<int>(std::lround(y0 * h)); y < std::lround(y1 * h); ++y) {
    for (int x = static_cast<int>(std::lround(x0 * w)); x < std::lround(x1 * w); ++x) {
      set(x, y, color);
    }
  }
  return *this;
}

Canvas& Canvas::frame(float x0, float y0, float x1, float y1, float thickness, Rgb color) {
  const float ty = thickness * static_cast<float>(width_) / static_cast<float>(height_);
  rect(x0, y0, x1, y0 + ty, color);
  rect(x0, y1 - ty, x1, y1, color);
  rect(x0, y0, x0 + thickness, y1, color);
  return rect(x1 - thickness, y0, x1, y1, color);
}

Canvas& Canvas::ellipse(float cx, float cy, float rx, float ry, Rgb color) {
  return shade([=](float u, float v, Rgb old) {
    const float x = (u - cx) / rx, y = (v - cy) / ry;
    return x * x + y * y <= 1 ? color : old;
  });
}

Canvas& Canvas::line(float x0, float y0, float x1, float y1, float thickness, Rgb color) {
  const auto w = static_cast<float>(width_), h = static_cast<float>(height_);
  const float ax = x0 * w, ay = y0 * h, dx = (x1 - x0) * w, dy = (y1 - y0) * h;
  const float radius = 0.5f * thickness * w, norm = std::max(dx * dx + dy * dy, 1e-9f);
  const auto low = [&](float a, float b) { return static_cast<int>(std::min(a, b) - radius - 1); };
  const auto high = [&](float a, float b) { return static_cast<int>(std::max(a, b) + radius + 1); };
  for (int y = low(ay, ay + dy); y <= high(ay, ay + dy); ++y) {
    for (int x = low(ax, ax + dx); x <= high(ax, ax + dx); ++x) {
      const float px = static_cast<float>(x) + 0.5f - ax, py = static_cast<float>(y) + 0.5f - ay;
      const float t = std::clamp((px * dx + py * dy) / norm, 0.0f, 1.0f);
      if (std::hypot(px - t * dx, py - t * dy) <= radius) {
        set(x, y, color);
      }
    }
  }
  return *this;
}

Canvas& Canvas::text(const std::string& words, float x, float y, float size, Rgb color,
                     float squeeze) {
  const float dot_height = size / 7;
  const float dot_width =
      dot_height * squeeze * static_cast<float>(height_) / static_cast<float>(width_);
  for (size_t i = 0; i < words.size(); ++i) {
    for (int row = 0; row < 7; ++row) {
      for (int column = 0; column < 5; ++column) {
        if (glyph_bit(words[i], column, row)) {
          const float left = x + dot_width * static_cast<float>(6 * static_cast<int>(i) + column);
          const float top = y + dot_height * static_cast<float>(row);
          rect(left, top, left + dot_width, top + dot_height, color);
        }
      }
    }
  }
  return *this;
}

Canvas& Canvas::text_down(const std::string& words, float x, float y, float size, Rgb color) {
  const float dot_width = size / 7;
  const float dot_height = dot_width * static_cast<float>(width_) / static_cast<float>(height_);
  for (size_t i = 0; i < words.size(); ++i) {
    for (int row = 0; row < 7; ++row) {
      for (int column = 0; column < 5; ++column) {
        if (glyph_bit(words[i], column, row)) {
          const float left = x + size - dot_width * static_cast<float>(row + 1);
          const float top = y + dot_height * static_cast<float>(6 * static_cast<int>(i) + column);
          rect(left, top, left + dot_width, top + dot_height, color);
        }
      }
    }
  }
  return *this;
}

Canvas& Canvas::mottle(float cells, float strength, uint32_t seed) {
  const float aspect = static_cast<float>(height_) / static_cast<float>(width_);
  return shade([=](float u, float v, Rgb old) {
    const float noise = fractal_noise(u * cells, v * cells * aspect, seed, 5) - 0.5f;
    return old * std::max(0.0f, 1 + 2 * strength * noise);
  });
}

Canvas& Canvas::cut(const std::function<bool(float, float)>& inside) {
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const float u = (static_cast<float>(x) + 0.5f) / static_cast<float>(width_);
      const float v = (static_cast<float>(y) + 0.5f) / static_cast<float>(height_);
      alpha_[index(x, y)] = inside(u, v) ? alpha_[index(x, y)] : 0.0f;
    }
  }
  return *this;
}

}  // namespace jade::world
