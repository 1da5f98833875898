// SPDX-License-Identifier: Apache-2.0
// Which quarters (8x8 px) of which tiles an ellipse reaches. Exact up to kExtentSlackPx: a quarter
// is reached when the ellipse comes near one of its pixel centres' bounding box.
#pragma once

#include "jade/splat/cuda/layout.h"
#include "jade/splat/math/tile.h"

namespace jade::splat::cuda {

/// The ellipse of a splat, as bands of rows see it.
struct Ellipse {
  float x, y;
  m::RowExtent<float> row;
  float half_y;    ///< with slack
  float right_dy;  ///< height of the rightmost point above the centre; the leftmost is opposite

  __device__ explicit Ellipse(const Splat& s) : x(s.x), y(s.y) {
    const float reach = fmaxf(m::reach(s.log2_opacity), 0.0f);
    const float inverse_a = float(-0.5 * m::kLog2E) / s.a;  // det / cov_yy
    const float cov_yy = inverse_a / s.shrink;
    const float cov_xx = s.c * cov_yy / s.a;
    row = {s.slope, reach * inverse_a, s.shrink};
    half_y = m::half_extent(reach, cov_yy);
    right_dy = row.slope * cov_yy * sqrtf(reach / cov_xx);
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
    const float right = x + row.slope * dy_right + slack + m::half_width(row, dy_right);
    const float left = x + row.slope * dy_left - slack - m::half_width(row, dy_left);
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
  int lo0, hi0, lo1, hi1;

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
  /// Bit 2 · row + column of the tile's quarters.
  __device__ uint32_t mask(int tile) const {
    const int left = 2 * tile, right = left + 1;
    return uint32_t(left >= lo0 && left <= hi0) | uint32_t(right >= lo0 && right <= hi0) << 1 |
           uint32_t(left >= lo1 && left <= hi1) << 2 | uint32_t(right >= lo1 && right <= hi1) << 3;
  }
};

/// Calls visit(tile index in the view, mask) for tile rows begin, begin + step, … up to end.
template <class Visit>
__device__ __forceinline__ void walk_rows(const Ellipse& e, int begin, int end, int step,
                                          const RenderCall& call, const Visit& visit) {
  for (int row = begin; row <= end; row += step) {
    const TileRow reached(e, row, call);
    const int last = reached.last_tile();
    for (int tile = reached.first_tile(); tile <= last; ++tile) {
      const uint32_t mask = reached.mask(tile);
      if (mask != 0) visit(row * call.tiles_x + tile, mask);
    }
  }
}

constexpr int kSerialRows = 6;  ///< taller splats are walked by the whole warp, a row per lane

/// Walks the tiles of every lane's splat. All 32 lanes must call it; `drawn` says which have one.
/// visit(splat of the walk, its index, tile, mask).
template <class Visit>
__device__ __forceinline__ void walk_tiles(const Splat& splat, bool drawn, int index,
                                           const RenderCall& call, const Visit& visit) {
  int lo = 0, hi = -1;
  const Ellipse ellipse(splat);
  if (drawn) ellipse.rows(call.tiles_y - 1, &lo, &hi);
  const bool tall = hi - lo >= kSerialRows;
  if (!tall) {
    walk_rows(ellipse, lo, hi, 1, call,
              [&](int tile, uint32_t mask) { visit(splat.depth, index, tile, mask); });
  }
  const int lane = threadIdx.x & 31;
  for (uint32_t todo = __ballot_sync(~0u, tall); todo != 0; todo &= todo - 1) {
    const int from = __ffs(todo) - 1;
    Ellipse shared = ellipse;
    shared.x = __shfl_sync(~0u, ellipse.x, from);
    shared.y = __shfl_sync(~0u, ellipse.y, from);
    shared.row.slope = __shfl_sync(~0u, ellipse.row.slope, from);
    shared.row.width2 = __shfl_sync(~0u, ellipse.row.width2, from);
    shared.row.shrink = __shfl_sync(~0u, ellipse.row.shrink, from);
    shared.half_y = __shfl_sync(~0u, ellipse.half_y, from);
    shared.right_dy = __shfl_sync(~0u, ellipse.right_dy, from);
    const float depth = __shfl_sync(~0u, splat.depth, from);
    const int shared_index = __shfl_sync(~0u, index, from);
    const int begin = __shfl_sync(~0u, lo, from), end = __shfl_sync(~0u, hi, from);
    walk_rows(shared, begin + lane, end, 32, call,
              [&](int tile, uint32_t mask) { visit(depth, shared_index, tile, mask); });
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
