// SPDX-License-Identifier: Apache-2.0
// Which splats are on which tile of a view, front to back.
#pragma once

#include <cstdint>
#include <vector>

#include "jade/splat/cpu/kernels.h"

namespace jade::splat::cpu {

struct TileGrid {
  int shift = 0;  ///< tiles are 2^shift pixels wide and high
  int columns = 0, rows = 0;
  TileGrid(int width, int height, int tile_shift)
      : shift(tile_shift),
        columns(((width - 1) >> tile_shift) + 1),
        rows(((height - 1) >> tile_shift) + 1) {}
  int tile_size() const { return 1 << shift; }
  int64_t tiles() const { return int64_t{columns} * rows; }
};

/// Gives every visible splat of a view its run of instance slots, in the order of the index.
/// Returns how many slots there are. @throws DeviceError beyond 2^32 of them.
template <class T>
int64_t assign_slots(Splat<T>* splats, int64_t count, const TileGrid& grid);

/// Fills `list` (assign_slots() entries) with splat indices, tile after tile in row-major order,
/// each tile's by (depth, index); tile t has list[offsets[t]] … list[offsets[t + 1] − 1].
template <class T>
void fill_lists(const Splat<T>* splats, int64_t count, const TileGrid& grid, int64_t* offsets,
                int32_t* list);

}  // namespace jade::splat::cpu
