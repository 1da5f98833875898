// SPDX-License-Identifier: Apache-2.0
// The pixels of a tile: their state during blending, and which of them a splat may cover.
#pragma once

#include <cstdint>
#include <cstring>
#include <type_traits>

#include "jade/splat/cpu/kernels.h"
#include "jade/splat/cpu/pack.h"
#include "jade/splat/math/blend.h"
#include "jade/splat/math/tile.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

namespace m = jade::splat::math;

/// Memory layout of a tile's pixels: blocks of as many pixels as a pack has lanes, four wide. A
/// block is one aligned load, and a splat of a few pixels uses more lanes of a block than of a row.
/// Blocks are numbered by words of 32: column c and band g of word w is block 32 w + 4 c + g, one
/// bit of a 32-bit word.
template <class P>
struct Blocks {
  static_assert(P::kLanes >= 4 && kMaxTile == 32, "four pixels wide, eight columns");
  static constexpr int kWidth = 4;
  static constexpr int kRows = P::kLanes / kWidth;     ///< of a block
  static constexpr int kColumns = kMaxTile / kWidth;   ///< of a tile
  static constexpr int kWordRows = P::kLanes;          ///< pixel rows of a word: four bands
  static constexpr int kWords = kMaxTile / kWordRows;  ///< of a tile
  static constexpr int kBlocks = 32 * kWords;

  /// Offset of the four pixels of row y in column c of blocks.
  JADE_HD static int segment(int c, int y) {
    const int block = y / kWordRows * 32 + 4 * c + y % kWordRows / kRows;
    return block * P::kLanes + y % kRows * kWidth;
  }
};

/// Calls body(offset in the image's plane, offset in the tile's planes, number of pixels) for each
/// run of a tile's pixels that is contiguous in both. The number is a constant if it is four.
template <class P, class Body, class T = typename P::Scalar>
JADE_HD void for_each_run(const Tile<T>& tile, int64_t image_width, const Body& body) {
  constexpr int kWidth = Blocks<P>::kWidth;
  for (int y = 0; y < tile.height; ++y) {
    const int64_t row = (tile.y0 + y) * image_width + tile.x0;
    int x = 0;
    for (; x + kWidth <= tile.width; x += kWidth) {
      body(row + x, Blocks<P>::segment(x / kWidth, y), std::integral_constant<int, kWidth>());
    }
    if (x < tile.width) body(row + x, Blocks<P>::segment(x / kWidth, y), tile.width - x);
  }
}

/// State of a tile in both blending passes. Pixels beyond the tile count as stopped.
template <class P>
struct TileState {
  using T = typename P::Scalar;
  using B = Blocks<P>;
  static constexpr int kSize = kMaxTile * kMaxTile;

  alignas(64) T transmittance[kSize];                      ///< negative once a pixel has stopped
  alignas(64) T center_x[B::kColumns][P::kLanes];          ///< px, of the pixels of a block
  alignas(64) T center_y[kMaxTile / B::kRows][P::kLanes];  ///< by band from the tile's top
  uint32_t live[B::kWords];  ///< one bit per block: set where a pixel has not stopped

  JADE_HD void reset(const Tile<T>& tile) {
    for (T& t : transmittance) t = T(-1);
    for_each_run<P>(tile, 0, [&](int64_t, int p, int count) {
      for (int i = 0; i < count; ++i) transmittance[p + i] = T(1);
    });
    for (int c = 0; c < B::kColumns; ++c) {
      for (int l = 0; l < P::kLanes; ++l) {
        center_x[c][l] = T(tile.x0 + c * B::kWidth + l % B::kWidth) + T(0.5);
      }
    }
    for (int band = 0; band < kMaxTile / B::kRows; ++band) {
      for (int l = 0; l < P::kLanes; ++l) {
        center_y[band][l] = T(tile.y0 + band * B::kRows + l / B::kWidth) + T(0.5);
      }
    }
    find_live();
  }

  /// Sets `live`. The blending loops do not update it: a stopped pixel costs only time, whereas
  /// branches of the next splat that wait for the last one's transmittance would stall the
  /// processor at every misprediction.
  JADE_HD void find_live() {
    for (int w = 0; w < B::kWords; ++w) {
      uint32_t found = 0;
      for (int bit = 0; bit < 32; ++bit) {
        const P t = P::load(transmittance + (32 * w + bit) * P::kLanes);
        found |= static_cast<uint32_t>(bits(t >= P(0)) != 0) << bit;
      }
      live[w] = found;
    }
  }

  JADE_HD bool any_live() const {
    uint32_t any = 0;
    for (const uint32_t word : live) any |= word;
    return any != 0;
  }
};

/// The blocks that a splat may cover on a tile, bits as in TileState::live, two words in one.
template <class P>
struct BlockMask {
  using T = typename P::Scalar;
  using B = Blocks<P>;
  using Columns = typename m::VectorOf<int32_t, P::kLanes>::Type;
  using Bits = typename m::VectorOf<uint32_t, P::kLanes>::Type;
  static constexpr int kPairs = B::kWords / 2;

  uint64_t pairs[kPairs];

  JADE_HD void set(const Splat<T>& splat, const Tile<T>& tile, const uint32_t* live) {
    const int y0 = splat.y0 > tile.y0 ? splat.y0 - tile.y0 : 0;
    const int y1 = splat.y1 < tile.y0 + tile.height ? splat.y1 - tile.y0 : tile.height;
    const int x0 = splat.x0 > tile.x0 ? splat.x0 - tile.x0 : 0;
    const int x1 = splat.x1 < tile.x0 + tile.width ? splat.x1 - tile.x0 : tile.width;
    const P low(static_cast<T>(x0)), high(static_cast<T>(x1));
    const P center(splat.x - T(tile.x0) + T(0.5));
    const m::RowExtent<P> extent{P(splat.slope), P(splat.width2), P(splat.shrink)};
    const P y(splat.y);
    for (uint64_t& pair : pairs) pair = 0;
    for (int w = y0 / B::kWordRows; w * B::kWordRows < y1; ++w) {
      // Rounded like the pixels' own dy, so that both agree on the rows at an ellipse's tips.
      const P d = (P::iota() + P(T(tile.y0 + w * B::kWordRows) + T(0.5))) - y;
      const P half = m::half_width(extent, d) + P(T(m::kExtentSlackPx));
      // The first column at or after the left end, and the first one beyond the right end.
      const P middle = center + extent.slope * d;
      const P left = min(max(middle - half, low), high);
      const P right = max(min(middle + half, high), left);
      const uint32_t covered = blocks_of(bits_below(right) ^ bits_below(left)) & live[w];
      pairs[w / 2] |= static_cast<uint64_t>(covered) << w % 2 * 32;
    }
  }

  /// Calls body(block) for every block of the mask.
  template <class Body>
  JADE_HD void for_each(const Body& body) const {
    for (int i = 0; i < kPairs; ++i) {
      for (uint64_t rest = pairs[i]; rest != 0; rest &= rest - 1) {
        body(64 * i + __builtin_ctzll(rest));
      }
    }
  }

 private:
  /// The lowest floor(n) bits of 32, for n from 0 to 32. (32 is split in two to avoid a shift by
  /// 32.)
  JADE_HD static Bits bits_below(P n) {
    const Columns columns = __builtin_convertvector(n.v, Columns);
    const Columns half = columns >> 1;
    const Bits one = Bits{} + 1;
    return ((one << (Bits)half) << (Bits)(columns - half)) - one;
  }

  /// Converts one bit per column of each of a word's rows to one bit per block.
  JADE_HD static uint32_t blocks_of(Bits columns) {
    columns |= columns >> 1;
    columns |= columns >> 2;
    columns &= Bits{} + 0x11111111u;
    Bits band;
    for (int l = 0; l < P::kLanes; ++l) band[l] = l / B::kRows;
    return any_of<P::kLanes>(columns << band);
  }

  template <int N, class V>
  JADE_HD static uint32_t any_of(V values) {
    if constexpr (N == 1) {
      return values[0];
    } else {
      using Half = typename m::VectorOf<uint32_t, N / 2>::Type;
      Half halves[2];
      std::memcpy(halves, &values, sizeof(values));
      return any_of<N / 2>(halves[0] | halves[1]);
    }
  }
};

/// Some splats of a tile's list with their blocks, computed ahead of the blending, so that its
/// branches do not wait for square roots.
template <class P>
struct SplatBatch {
  using T = typename P::Scalar;
  static constexpr int kSize = 16;

  int size;
  const Splat<T>* splats[kSize];
  BlockMask<P> blocks[kSize];

  JADE_HD void take(const Tile<T>& tile, int64_t begin, const uint32_t* live) {
    const int64_t rest = tile.list_size - begin;
    size = rest < kSize ? static_cast<int>(rest) : kSize;
    for (int i = 0; i < size; ++i) {
      splats[i] = tile.splats + tile.list[begin + i];
      if (kSize + i < rest) __builtin_prefetch(tile.splats + tile.list[begin + kSize + i]);
      blocks[i].set(*splats[i], tile, live);
    }
  }
};

/// Offsets of a block's pixels in the planes, and their centres.
template <class P>
struct BlockPlace {
  int pixel, column, band;
  JADE_HD explicit BlockPlace(int block)
      : pixel(block * P::kLanes), column(block >> 2 & 7), band(block >> 5 << 2 | (block & 3)) {}
};

/// Constants of a splat over all of its pixels.
template <class P>
struct SplatFalloff {
  P x, y, log2_opacity;
  m::Falloff<P> falloff;

  template <class T>
  JADE_HD explicit SplatFalloff(const Splat<T>& s)
      : x(s.x), y(s.y), log2_opacity(s.log2_opacity), falloff{P(s.a), P(s.b), P(s.c)} {}

  JADE_HD P exponent(P dx, P dy) const {
    return m::exponent(m::at_row(falloff, log2_opacity, dy), dx);
  }
};

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
