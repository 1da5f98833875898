// SPDX-License-Identifier: Apache-2.0
// The splats of a tile to its pixels, front to back.
#pragma once

#include <cstdint>
#include <cstring>

#include "jade/splat/cpu/kernels.h"
#include "jade/splat/cpu/pack.h"
#include "jade/splat/cpu/tile_pixels.h"
#include "jade/splat/math/blend.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

/// Colour and depth under the splats blended so far, in rows of TileState::kStride.
template <class P, int kPlanes>
struct TilePlanes {
  using T = typename P::Scalar;
  alignas(64) T values[kPlanes][TileState<P>::kSize];

  JADE_HD explicit TilePlanes(const Tile<T>& tile) {
    for (auto& plane : values) {
      std::memset(plane, 0, sizeof(T) * TileState<P>::kStride * tile.height);
    }
  }
};

/// Blends one splat into the pixels that it may cover.
template <bool kSmooth, class P, int kPlanes, class T = typename P::Scalar>
JADE_HD void blend_splat(const Splat<T>& splat, const PackList<P>& packs, TileState<P>* state,
                         TilePlanes<P, kPlanes>* planes) {
  const P center(splat.x), a(splat.a);
  const P values[4] = {P(splat.color[0]), P(splat.color[1]), P(splat.color[2]), P(splat.depth)};
  for (int n = 0; n < packs.count; ++n) {
    const PackPlace<P> at(packs.places[n]);
    P t = P::load(state->transmittance + at.pixel);
    const auto step = m::blend_step<m::PlainArithmetic, kSmooth>(
        m::exponent(packs.row(a, at.y), P::load(state->center_x + at.x) - center), &t);
    t.store(state->transmittance + at.pixel);
    for (int k = 0; k < kPlanes; ++k) {
      T* const plane = planes->values[k] + at.pixel;
      fma(step.weight, values[k], P::load(plane)).store(plane);
    }
    state->keep_live(at.y, at.x, bits(step.goes_on));
  }
}

template <class P, int kPlanes, class T = typename P::Scalar>
JADE_HD void store_images(const RenderCall<T>& call, const Tile<T>& tile, const TileState<P>& state,
                          const TilePlanes<P, kPlanes>& planes, const Images<T>& images) {
  const int64_t plane_size = static_cast<int64_t>(call.width) * call.height;
  for (int y = 0; y < tile.height; ++y) {
    const int64_t row = static_cast<int64_t>(tile.y0 + y) * call.width + tile.x0;
    for (int x = 0; x < tile.width; ++x) {
      const int p = y * TileState<P>::kStride + x;
      const T t = m::abs(state.transmittance[p]);
      for (int c = 0; c < 3; ++c) {
        images.color[c * plane_size + row + x] = planes.values[c][p] + t * call.background[c];
      }
      images.alpha[row + x] = T(1) - t;
      if (kPlanes == 4) images.depth_sum[row + x] = planes.values[3][p];
    }
  }
}

template <class P, bool kSmooth, bool kDepth, class T = typename P::Scalar>
void blend_tile(const RenderCall<T>& call, const Tile<T>& tile, const Images<T>& images) {
  TileState<P> state;
  state.reset(tile);
  TilePlanes<P, kDepth ? 4 : 3> planes(tile);
  PackList<P> packs;
  for (int64_t i = 0; i < tile.list_size && state.any_live(); ++i) {
    const Splat<T>& splat = tile.splats[tile.list[i]];
    if (i + 2 < tile.list_size) __builtin_prefetch(tile.splats + tile.list[i + 2]);
    packs.build(splat, tile, state.live);
    blend_splat<kSmooth>(splat, packs, &state, &planes);
  }
  store_images(call, tile, state, planes, images);
}

template <class P, class T = typename P::Scalar>
void blend(const RenderCall<T>& call, const Tile<T>& tile, const Images<T>& images) {
  const auto run =
      call.smooth_cutoff
          ? (call.depth ? blend_tile<P, true, true, T> : blend_tile<P, true, false, T>)
          : (call.depth ? blend_tile<P, false, true, T> : blend_tile<P, false, false, T>);
  run(call, tile, images);
}

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
