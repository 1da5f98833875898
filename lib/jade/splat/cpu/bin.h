// SPDX-License-Identifier: Apache-2.0
// Lists the splats on each tile of a view, front to back.
#pragma once

#include <cstdint>

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

/// Lists are built in parts: runs of consecutive splats, each processed by any thread. First the
/// parts count, then assign_positions() computes where each writes, then they write, then tiles are
/// sorted; the result does not depend on the number of parts.
///
/// Counts the instances of splats [begin, end) per tile into counts [tiles].
template <class T>
void count_instances(const Splat<T>* splats, int64_t begin, int64_t end, const TileGrid& grid,
                     uint32_t* counts);

/// Converts counts [parts, tiles] of a view to the position in its list of each part's first entry
/// of a tile, ordered by tile (row-major) and then by part. Writes the tiles' bounds, offsets
/// [tiles + 1], and the first instance slot of each part, slots [parts]. Returns the number of
/// instances.
/// @throws DeviceError beyond 2^32 of them.
int64_t assign_positions(uint32_t* counts, int64_t parts, int64_t tiles, int64_t* offsets,
                         uint32_t* slots);

/// Writes splats [begin, end) into `list` at next [tiles], which it advances, and gives each its
/// run of instance slots from `slot` on; both in the order of the index.
template <class T>
void place_instances(Splat<T>* splats, int64_t begin, int64_t end, const TileGrid& grid,
                     uint32_t slot, uint32_t* next, int32_t* list);

/// Sorts a tile's list, initially ordered by index, by (depth, index).
template <class T>
void sort_by_depth(const Splat<T>* splats, int32_t* list, int64_t size);

}  // namespace jade::splat::cpu
