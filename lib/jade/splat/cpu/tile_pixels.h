// SPDX-License-Identifier: Apache-2.0
// The pixels of a tile: their state while splats are blended, and which of them a splat may cover.
#pragma once

#include <cstdint>
#include <cstring>

#include "jade/splat/cpu/kernels.h"
#include "jade/splat/cpu/pack.h"
#include "jade/splat/math/blend.h"
#include "jade/splat/math/tile.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

namespace m = jade::splat::math;

/// What both blending passes keep about a tile. Pixels are in rows of kStride values; those beyond
/// the tile, where a pack may reach, count as stopped.
template <class P>
struct TileState {
  using T = typename P::Scalar;
  static constexpr int kStride = kMaxTile + P::kLanes;
  static constexpr int kSize = kMaxTile * kStride;

  alignas(64) T transmittance[kSize];  ///< negative once a pixel has stopped
  alignas(64) T center_x[kStride];     ///< of each column, px
  uint32_t live[kMaxTile];             ///< by row, one bit per pixel that has not stopped

  JADE_HD void reset(const Tile<T>& tile) {
    for (int i = 0; i < tile.height * kStride; ++i) transmittance[i] = T(-1);
    std::memset(live, 0, sizeof(live));
    for (int y = 0; y < tile.height; ++y) {
      for (int x = 0; x < tile.width; ++x) transmittance[y * kStride + x] = T(1);
      live[y] = tile.width == 32 ? ~0u : (1u << tile.width) - 1;
    }
    for (int x = 0; x < kStride; ++x) center_x[x] = T(tile.x0 + x) + T(0.5);
  }

  /// Of the pack of pixels from column x on, keeps those that go on. No branch: it would be
  /// mispredicted.
  JADE_HD void keep_live(uint32_t y, uint32_t x, uint32_t goes_on) {
    constexpr uint32_t kPack = (1u << P::kLanes) - 1;
    live[y] &= ~((goes_on ^ kPack) << x);
  }

  JADE_HD bool any_live() const {
    uint32_t any = 0;
    for (const uint32_t row : live) any |= row;
    return any != 0;
  }
};

/// Where a pack of pixels begins on its tile.
template <class P>
struct PackPlace {
  uint32_t x, y;
  uint32_t pixel;  ///< in rows of TileState::kStride
  JADE_HD explicit PackPlace(uint32_t place)
      : x(place & 0xffff), y(place >> 16), pixel(y * TileState<P>::kStride + x) {}
};

/// The packs of pixels that a splat may cover on a tile, as one list: a loop over rows with an
/// inner loop over one or two packs would be mispredicted in every other row.
template <class P>
struct PackList {
  using T = typename P::Scalar;
  static constexpr int kPerRow = kMaxTile / P::kLanes;

  using Columns = typename m::VectorOf<int32_t, P::kLanes>::Type;
  using Bits = typename m::VectorOf<uint32_t, P::kLanes>::Type;

  int count;
  uint32_t places[kMaxTile * kPerRow + kPerRow];  ///< y · 2^16 + x: PackPlace
  // By row of the tile.
  alignas(64) T dy[kMaxTile + P::kLanes];
  alignas(64) T row_b[kMaxTile + P::kLanes];  ///< math::RowFalloff
  alignas(64) T row_c[kMaxTile + P::kLanes];
  alignas(64) uint32_t span[kMaxTile + P::kLanes];  ///< one bit per column

  JADE_HD void build(const Splat<T>& splat, const Tile<T>& tile, const uint32_t* live) {
    const int y0 = splat.y0 > tile.y0 ? splat.y0 - tile.y0 : 0;
    const int y1 = splat.y1 < tile.y0 + tile.height ? splat.y1 - tile.y0 : tile.height;
    set_rows(splat, tile, y0, y1);
    int next = 0;
    for (int y = y0; y < y1; ++y) {
      const uint32_t wanted = live[y] & span[y];
      if (wanted == 0) continue;
      const int first = __builtin_ctz(wanted), last = 31 - __builtin_clz(wanted);
      const uint32_t place = static_cast<uint32_t>(y) << 16 | static_cast<uint32_t>(first);
      for (int k = 0; k < kPerRow; ++k) places[next + k] = place + k * P::kLanes;
      next += static_cast<unsigned>(last - first) / P::kLanes + 1;
    }
    count = next;
  }

  JADE_HD m::RowFalloff<P> row(P a, uint32_t y) const { return {a, P(row_b[y]), P(row_c[y])}; }

 private:
  JADE_HD void set_rows(const Splat<T>& splat, const Tile<T>& tile, int y0, int y1) {
    const int x0 = splat.x0 > tile.x0 ? splat.x0 - tile.x0 : 0;
    const int x1 = splat.x1 < tile.x0 + tile.width ? splat.x1 - tile.x0 : tile.width;
    const P low(static_cast<T>(x0)), high(static_cast<T>(x1));
    const P center(splat.x - T(tile.x0) + T(0.5));
    const m::Falloff<P> falloff{P(splat.a), P(splat.b), P(splat.c)};
    const m::RowExtent<P> extent{P(splat.slope), P(splat.width2), P(splat.shrink)};
    for (int y = y0; y < y1; y += P::kLanes) {
      const P d = (P::iota() + P(T(tile.y0 + y) + T(0.5))) - P(splat.y);
      d.store(dy + y);
      const m::RowFalloff<P> row = m::at_row(falloff, P(splat.log2_opacity), d);
      row.b.store(row_b + y);
      row.c.store(row_c + y);
      const P half = m::half_width(extent, d) + P(T(m::kExtentSlackPx));
      // The first column at or after the left end, and one past the last before the right end.
      const P middle = center + extent.slope * d;
      const P left = min(max(middle - half, low), high);
      const P right = max(min(middle + half, high), left);
      const Columns bits = bits_below(right) ^ bits_below(left);
      std::memcpy(span + y, &bits, sizeof(bits));
    }
  }

  /// The lowest floor(n) bits of 32, for n from 0 to 32. (32 is cut in two: no shift by 32.)
  JADE_HD static Columns bits_below(P n) {
    const Columns columns = __builtin_convertvector(n.v, Columns);
    const Columns half = columns >> 1;
    const Bits one = Bits{} + 1;
    return (Columns)(((one << (Bits)half) << (Bits)(columns - half)) - one);
  }
};

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
