// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "jade/world/canvas.h"

namespace jade::world {

/// An image pyramid, so that a lookup returns no detail finer than the requesting pixel. (u,v) in
/// [0,1] covers the picture once, v downwards; it repeats outside.
class Texture {
 public:
  explicit Texture(const Canvas& canvas);

  /// Colour averaged over about `footprint` (a fraction of the picture's width), trilinear.
  Rgb sample(float u, float v, float footprint) const;
  /// Opacity, averaged in the same way.
  float opacity(float u, float v, float footprint) const;

 private:
  struct Level {
    int width, height;
    std::vector<uint8_t> rgba;
  };
  struct Blend {
    int level;
    float fraction;
  };
  Blend blend(float footprint) const;
  static void lookup(const Level& level, float u, float v, float rgba[4]);

  std::vector<Level> levels_;
};

}  // namespace jade::world
