// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "jade/kernel/host_device.h"
#include "jade/splat/cpu/kernels.h"

namespace jade::splat::cpu {

/// The tiles of a view that a splat's box touches. Its instances are in row-major order of the
/// tiles.
struct TileBox {
  int16_t x0, x1, y0, y1;  ///< last included

  template <class T>
  JADE_HD TileBox(const Splat<T>& s, int tile_shift)
      : x0(static_cast<int16_t>(s.x0 >> tile_shift)),
        x1(static_cast<int16_t>((s.x1 - 1) >> tile_shift)),
        y0(static_cast<int16_t>(s.y0 >> tile_shift)),
        y1(static_cast<int16_t>((s.y1 - 1) >> tile_shift)) {}
  JADE_HD int64_t count() const { return int64_t{x1 - x0 + 1} * (y1 - y0 + 1); }
  /// Index of the tile in column x and row y among them.
  JADE_HD int64_t place(int x, int y) const { return int64_t{y - y0} * (x1 - x0 + 1) + (x - x0); }
};

}  // namespace jade::splat::cpu
