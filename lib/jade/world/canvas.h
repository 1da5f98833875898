// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "jade/world/vec.h"

namespace jade::world {

/// An image for painting a texture, before it is band-limited into a Texture. Coordinates are
/// fractions of the canvas, (0,0) top left, (1,1) bottom right.
class Canvas {
 public:
  Canvas(int width, int height, Rgb fill);

  int width() const { return width_; }
  int height() const { return height_; }
  Rgb color(int x, int y) const { return color_[index(x, y)]; }
  float alpha(int x, int y) const { return alpha_[index(x, y)]; }

  /// Sets every pixel to paint(u, v, old colour).
  Canvas& shade(const std::function<Rgb(float u, float v, Rgb old)>& paint);
  Canvas& rect(float x0, float y0, float x1, float y1, Rgb color);
  Canvas& frame(float x0, float y0, float x1, float y1, float thickness, Rgb color);
  /// Radii are fractions of the width and of the height.
  Canvas& ellipse(float cx, float cy, float rx, float ry, Rgb color);
  Canvas& line(float x0, float y0, float x1, float y1, float thickness, Rgb color);
  /// Prints capitals, digits and some signs in a 5×7 face; `size` is the letter height.
  /// @param squeeze  letter width as a multiple of its natural width
  Canvas& text(const std::string& words, float x, float y, float size, Rgb color,
               float squeeze = 1.0f);
  /// Draws text downwards (rotated by 90 degrees, as on the spine of a book).
  Canvas& text_down(const std::string& words, float x, float y, float size, Rgb color);
  /// Multiplies the colour by 1 ± strength, from fractal noise with `cells` cells across.
  Canvas& mottle(float cells, float strength, uint32_t seed);
  /// Makes the pixels transparent where inside(u, v) is false.
  Canvas& cut(const std::function<bool(float u, float v)>& inside);
  /// Width in `size` units that text() needs.
  static float text_width(const std::string& words) {
    return 6.0f / 7.0f * static_cast<float>(words.size());
  }

 private:
  size_t index(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
  }
  void set(int x, int y, Rgb color);

  int width_, height_;
  std::vector<Rgb> color_;
  std::vector<float> alpha_;
};

}  // namespace jade::world
