// SPDX-License-Identifier: Apache-2.0
// Blends the splats of a tile into its pixels, front to back.
#pragma once

#include <cstdint>
#include <cstring>

#include "jade/splat/cpu/kernels.h"
#include "jade/splat/cpu/pack.h"
#include "jade/splat/cpu/tile_pixels.h"
#include "jade/splat/math/blend.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

/// Accumulated colour and depth of the splats blended so far, in blocks as in TileState.
template <class P, int kPlanes>
struct TilePlanes {
  using T = typename P::Scalar;
  alignas(64) T values[kPlanes][TileState<P>::kSize];

  JADE_HD TilePlanes() { std::memset(values, 0, sizeof(values)); }
};

/// Blends one splat into the pixels that it may cover.
template <bool kSmooth, class P, int kPlanes, class T = typename P::Scalar>
JADE_HD void blend_splat(const Splat<T>& splat, const BlockMask<P>& blocks, P max_alpha,
                         TileState<P>* state, TilePlanes<P, kPlanes>* planes) {
  const SplatFalloff<P> falloff(splat);
  const P values[4] = {P(splat.color[0]), P(splat.color[1]), P(splat.color[2]), P(splat.depth)};
  blocks.for_each([&](int block) {
    const BlockPlace<P> at(block);
    const P dx = P::load(state->center_x[at.column]) - falloff.x;
    const P dy = P::load(state->center_y[at.band]) - falloff.y;
    P t = P::load(state->transmittance + at.pixel);
    const auto step =
        m::blend_step<m::PlainArithmetic, kSmooth>(falloff.exponent(dx, dy), max_alpha, &t);
    t.store(state->transmittance + at.pixel);
    for (int k = 0; k < kPlanes; ++k) {
      T* const plane = planes->values[k] + at.pixel;
      fma(step.weight, values[k], P::load(plane)).store(plane);
    }
  });
}

template <class P, int kPlanes, class T = typename P::Scalar>
JADE_HD void store_images(const RenderCall<T>& call, const Tile<T>& tile, const TileState<P>& state,
                          const TilePlanes<P, kPlanes>& planes, const Images<T>& images) {
  const int64_t plane_size = static_cast<int64_t>(call.width) * call.height;
  for_each_run<P>(tile, call.width, [&](int64_t to, int p, auto count) {
    T left[Blocks<P>::kWidth];
    for (int i = 0; i < count; ++i) left[i] = m::abs(state.transmittance[p + i]);
    for (int c = 0; c < 3; ++c) {
      const T* const under = planes.values[c] + p;
      if (call.interleaved) {
        T* const out = images.color + 3 * to + c;
        for (int i = 0; i < count; ++i) out[3 * i] = under[i] + left[i] * call.background[c];
      } else {
        T* const out = images.color + c * plane_size + to;
        for (int i = 0; i < count; ++i) out[i] = under[i] + left[i] * call.background[c];
      }
    }
    for (int i = 0; i < count; ++i) images.alpha[to + i] = T(1) - left[i];
    if constexpr (kPlanes == 4) {
      for (int i = 0; i < count; ++i) images.depth_sum[to + i] = planes.values[3][p + i];
    }
  });
}

template <class P, bool kSmooth, bool kDepth, class T = typename P::Scalar>
void blend_tile(const RenderCall<T>& call, const Tile<T>& tile, const Images<T>& images) {
  TileState<P> state;
  state.reset(tile);
  TilePlanes<P, kDepth ? 4 : 3> planes;
  SplatBatch<P> batch;
  const P max_alpha(call.max_alpha);
  for (int64_t i = 0; i < tile.list_size && state.any_live(); i += batch.size) {
    batch.take(tile, i, state.live);
    for (int k = 0; k < batch.size; ++k) {
      blend_splat<kSmooth>(*batch.splats[k], batch.blocks[k], max_alpha, &state, &planes);
    }
    state.find_live();
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
