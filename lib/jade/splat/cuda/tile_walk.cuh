// SPDX-License-Identifier: Apache-2.0
// Which quarters (8x8 px) of which tiles an ellipse reaches. Exact up to kExtentSlackPx: it reaches
// a quarter if it comes near the bounding box of its pixel centres.
#pragma once

#include "jade/splat/cuda/layout.h"
#include "jade/splat/cuda/warp.cuh"
#include "jade/splat/math/tile.h"

namespace jade::splat::cuda {

/// To 1 ulp, which is far below kExtentSlackPx.
__device__ __forceinline__ float fast_sqrt(float x) {
#ifdef __CUDACC__
  asm("sqrt.approx.ftz.f32 %0, %0;" : "+f"(x));
  return x;
#else
  return sqrtf(x);  // tests/emulated
#endif
}

/// The ellipse of a splat, for queries by bands of rows.
struct Ellipse {
  float x, y;
  m::RowExtent<float> row;
  float half_y;    ///< with slack
  float right_dy;  ///< height of the rightmost point above the centre; the leftmost is opposite

  __device__ explicit Ellipse(const Splat& s) : x(s.x), y(s.y) {
    const float reach = fmaxf(m::reach(s.log2_opacity), 0.0f);
    const float inverse_a = float(-0.5 * m::kLog2E) / s.a;  // det / cov_yy
    const float cov_yy = inverse_a / s.shrink;
    const float cov_xx = __fdividef(s.c * cov_yy, s.a);
    row = {s.slope, reach * inverse_a, s.shrink};
    half_y = m::half_extent(reach, cov_yy);
    // Rounding hardly matters here: the width is stationary.
    right_dy = row.slope * cov_yy * fast_sqrt(__fdividef(reach, cov_xx));
  }

  /// First and last quarter column reached in the band `band` of quarter rows; empty if lo > hi.
  __device__ void columns(int band, int last_column, int* lo, int* hi) const {
    const float top = float(kSubtile * band) + 0.5f - y, bottom = top + float(kSubtile - 1);
    *lo = 1;
    *hi = 0;
    if (top > half_y || bottom < -half_y) return;
    const float dy_right = fminf(fmaxf(right_dy, top), bottom);
    const float dy_left = fminf(fmaxf(-right_dy, top), bottom);
    const float slack = float(m::kExtentSlackPx);
    const float right = x + row.slope * dy_right + slack + fast_sqrt(m::half_width2(row, dy_right));
    const float left = x + row.slope * dy_left - slack - fast_sqrt(m::half_width2(row, dy_left));
    // Quarter column s holds pixel centres 8 s + 0.5 to 8 s + 7.5.
    *lo = int(fmaxf(ceilf((left - 7.5f) * 0.125f), 0.0f));
    *hi = int(fminf(floorf((right - 0.5f) * 0.125f), float(last_column)));
  }

  /// First and last tile row that may be reached.
  __device__ void rows(int last_row, int* lo, int* hi) const {
    *lo = int(fmaxf(ceilf((y - half_y - 15.5f) * 0.0625f), 0.0f));
    *hi = int(fminf(floorf((y + half_y - 0.5f) * 0.0625f), float(last_row)));
  }
};

/// The reached quarters of one tile row.
struct TileRow {
  int lo0 = 1, hi0 = 0, lo1 = 1, hi1 = 0;  ///< in both bands; none

  TileRow() = default;
  __device__ TileRow(const Ellipse& e, int row, const RenderCall& call) {
    const int last = 2 * call.tiles_x - 1;
    e.columns(2 * row, last, &lo0, &hi0);
    e.columns(2 * row + 1, last, &lo1, &hi1);
  }
  __device__ int first_tile() const {
    return lo0 > hi0 ? lo1 >> 1 : lo1 > hi1 ? lo0 >> 1 : min(lo0, lo1) >> 1;
  }
  __device__ int last_tile() const {
    if (lo0 > hi0 && lo1 > hi1) return -1;
    return lo0 > hi0 ? hi1 >> 1 : lo1 > hi1 ? hi0 >> 1 : max(hi0, hi1) >> 1;
  }
  /// How many tiles have a reached quarter.
  __device__ int count() const {
    const int upper = lo0 > hi0 ? 0 : (hi0 >> 1) - (lo0 >> 1) + 1;
    const int lower = lo1 > hi1 ? 0 : (hi1 >> 1) - (lo1 >> 1) + 1;
    if (upper == 0 || lower == 0) return upper + lower;
    return upper + lower - max((min(hi0, hi1) >> 1) - (max(lo0, lo1) >> 1) + 1, 0);
  }
  /// Bit 2 · row + column of the tile's quarters.
  __device__ uint32_t mask(int tile) const {
    const int left = 2 * tile, right = left + 1;
    return uint32_t(left >= lo0 && left <= hi0) | uint32_t(right >= lo0 && right <= hi0) << 1 |
           uint32_t(left >= lo1 && left <= hi1) << 2 | uint32_t(right >= lo1 && right <= hi1) << 3;
  }
};

/// Calls visit(tile index in the view, mask) for the tiles of tile row `row`.
template <class Visit>
__device__ __forceinline__ void walk_row(const TileRow& reached, int row, const RenderCall& call,
                                         const Visit& visit) {
  const int last = reached.last_tile();
#pragma unroll 1  // mostly once or twice
  for (int tile = reached.first_tile(); tile <= last; ++tile) {
    const uint32_t mask = reached.mask(tile);
    if (mask != 0) visit(row * call.tiles_x + tile, mask);
  }
}

/// Walks tile rows begin to end only.
template <class Visit>
__device__ __forceinline__ void walk_rows(const Ellipse& e, int begin, int end,
                                          const RenderCall& call, const Visit& visit) {
  for (int row = begin; row <= end; ++row) walk_row({e, row, call}, row, call, visit);
}

__device__ __forceinline__ Ellipse ellipse_of(const Ellipse& mine, int lane) {
  Ellipse other = mine;
  other.x = __shfl_sync(~0u, mine.x, lane);
  other.y = __shfl_sync(~0u, mine.y, lane);
  other.row.slope = __shfl_sync(~0u, mine.row.slope, lane);
  other.row.width2 = __shfl_sync(~0u, mine.row.width2, lane);
  other.row.shrink = __shfl_sync(~0u, mine.row.shrink, lane);
  other.half_y = __shfl_sync(~0u, mine.half_y, lane);
  other.right_dy = __shfl_sync(~0u, mine.right_dy, lane);
  return other;
}

/// Walks the tiles of every lane's splat; `drawn` is set for lanes that have one. Splats differ
/// much in their number of rows, so rows are distributed over the lanes. All 32 lanes must call it.
/// They call expect(lane that owns this row, number of its reached tiles), then each visit(tile,
/// mask) for these.
template <class Expect, class Visit>
__device__ __forceinline__ void walk_tiles(const Splat& splat, bool drawn, const RenderCall& call,
                                           const Expect& expect, const Visit& visit) {
  const int lane = threadIdx.x & 31;
  int lo = 0, hi = -1;
  const Ellipse mine(splat);
  if (drawn) mine.rows(call.tiles_y - 1, &lo, &hi);
  const Shares rows(max(hi - lo + 1, 0), lane);
  for (uint32_t first = 0; first < rows.total; first += 32) {
    const uint32_t i = first + lane;
    const int owner = rows.owner(i);
    const int row = int(i) + __shfl_sync(~0u, lo - int(rows.begin), owner);
    const Ellipse ellipse = ellipse_of(mine, owner);
    TileRow reached;
    if (i < rows.total) reached = TileRow(ellipse, row, call);
    expect(owner, reached.count());
    walk_row(reached, row, call, visit);
  }
}

__device__ __forceinline__ uint64_t make_key(float depth, int index, uint32_t mask) {
  return uint64_t(__float_as_uint(depth)) << 32 | uint32_t(index) << kMaskBits | mask;
}

__device__ __forceinline__ Splat load_splat(const Splat* source) {
  const float4* const in = reinterpret_cast<const float4*>(source);
  Splat splat;
  float4* const out = reinterpret_cast<float4*>(&splat);
  for (int k = 0; k < 3; ++k) out[k] = __ldg(in + k);
  return splat;
}

}  // namespace jade::splat::cuda
