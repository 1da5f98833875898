// SPDX-License-Identifier: Apache-2.0
// Which splats are on which tile of a view, front to back.
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

/// Lists are made in parts: runs of splats that follow each other, each by any thread. First the
/// parts count, then assign_positions() says where each writes, then they write, then tiles are
/// sorted; nothing depends on how many parts there are.
///
/// Counts the instances of splats [begin, end) per tile into counts [tiles].
template <class T>
void count_instances(const Splat<T>* splats, int64_t begin, int64_t end, const TileGrid& grid,
                     uint32_t* counts);

/// Turns counts [parts, tiles] of a view into where in its list each part's first entry of a tile
/// belongs, by tile in row-major order and then by part. Writes the tiles' bounds, offsets
/// [tiles + 1], and the first instance slot of each part, slots [parts]. Returns how many instances
/// there are. @throws DeviceError beyond 2^32 of them.
int64_t assign_positions(uint32_t* counts, int64_t parts, int64_t tiles, int64_t* offsets,
                         uint32_t* slots);

/// Writes splats [begin, end) into `list` at next [tiles], which move on, and gives each its run of
/// instance slots from `slot` on; both in the order of the index.
template <class T>
void place_instances(Splat<T>* splats, int64_t begin, int64_t end, const TileGrid& grid,
                     uint32_t slot, uint32_t* next, int32_t* list);

/// Sorts a tile's list by (depth, index). It comes by index.
template <class T>
void sort_by_depth(const Splat<T>* splats, int32_t* list, int64_t size);

}  // namespace jade::splat::cpu
