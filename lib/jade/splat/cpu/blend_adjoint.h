// SPDX-License-Identifier: Apache-2.0
// Computes sums per splat from the gradients of a tile's pixels by replaying the blending, see
// math/blend.h.
#pragma once

#include <cstdint>
#include <cstring>

#include "jade/splat/cpu/kernels.h"
#include "jade/splat/cpu/pack.h"
#include "jade/splat/cpu/tile_box.h"
#include "jade/splat/cpu/tile_pixels.h"
#include "jade/splat/math/blend.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

/// dL/dpixel of a tile and the contribution of the remaining splats. kExtra: there are gradients of
/// alpha or depth.
template <class P, bool kExtra>
struct TileGradients {
  using T = typename P::Scalar;
  static constexpr int kPlanes = kExtra ? 5 : 3;  ///< dL/dcolour, dL/dalpha, dL/ddepth

  alignas(64) T behind[TileState<P>::kSize];
  alignas(64) T planes[kPlanes][TileState<P>::kSize];

  JADE_HD TileGradients(const RenderCall<T>& call, const Tile<T>& tile, const Images<T>& images,
                        const ImageGradients<T>& gradients) {
    std::memset(behind, 0, sizeof(behind));
    std::memset(planes, 0, sizeof(planes));
    const int64_t plane_size = static_cast<int64_t>(call.width) * call.height;
    const bool interleaved = call.interleaved && gradients.color != nullptr;
    if (interleaved) {
      for_each_run<P>(tile, call.width, [&](int64_t from, int p, auto count) {
        for (int k = 0; k < 3; ++k) {
          const T* const grad = gradients.color + 3 * from + k;
          const T* const image = images.color + 3 * from + k;
          for (int i = 0; i < count; ++i) planes[k][p + i] = grad[3 * i];
          for (int i = 0; i < count; ++i) behind[p + i] += grad[3 * i] * image[3 * i];
        }
      });
    }
    for (int k = interleaved ? 3 : 0; k < kPlanes; ++k) {
      const T* const grad = k < 3 ? (gradients.color ? gradients.color + k * plane_size : nullptr)
                                  : (k == 3 ? gradients.alpha : gradients.depth_sum);
      const T* const image =
          k < 3 ? images.color + k * plane_size : (k == 3 ? images.alpha : images.depth_sum);
      if (grad == nullptr) continue;
      for_each_run<P>(tile, call.width, [&](int64_t from, int p, auto count) {
        for (int i = 0; i < count; ++i) planes[k][p + i] = grad[from + i];
        for (int i = 0; i < count; ++i) behind[p + i] += grad[from + i] * image[from + i];
      });
    }
  }
};

/// Sums over the pixels of one splat on one tile.
template <class P>
struct LaneSums {
  m::Moments<P> moments{};
  P color[3] = {P(0), P(0), P(0)}, depth{0};

  /// Adds a pack's u = dL/d ln α.
  JADE_HD void add(P u, P dx, P dy) {
    const P ux = u * dx, uy = u * dy;
    moments.u = moments.u + u;
    moments.x = moments.x + ux;
    moments.y = moments.y + uy;
    moments.xx = fma(ux, dx, moments.xx);
    moments.xy = fma(ux, dy, moments.xy);
    moments.yy = fma(uy, dy, moments.yy);
  }

  template <class T>
  JADE_HD void store(bool with_depth, T* out) const {
    const P first[8] = {moments.u,  moments.x,  moments.y, moments.xx,
                        moments.xy, moments.yy, color[0],  color[1]};
    store_sums(first, out);
    out[8] = sum(color[2]);
    if (with_depth) out[9] = sum(depth);
  }
};

/// Replays one splat on the pixels that it may cover.
template <bool kSmooth, class P, bool kExtra, class T = typename P::Scalar>
JADE_HD LaneSums<P> replay_splat(const Splat<T>& splat, const BlockMask<P>& blocks, P max_alpha,
                                 TileState<P>* state, TileGradients<P, kExtra>* gradients) {
  constexpr int kPlanes = TileGradients<P, kExtra>::kPlanes;
  const SplatFalloff<P> falloff(splat);
  const P depth(splat.depth);
  const P color[3] = {P(splat.color[0]), P(splat.color[1]), P(splat.color[2])};
  LaneSums<P> sums;
  blocks.for_each([&](int block) {
    const BlockPlace<P> at(block);
    const P dx = P::load(state->center_x[at.column]) - falloff.x;
    const P dy = P::load(state->center_y[at.band]) - falloff.y;
    P t = P::load(state->transmittance + at.pixel);
    const auto step =
        m::blend_step<m::PlainArithmetic, kSmooth>(falloff.exponent(dx, dy), max_alpha, &t);
    t.store(state->transmittance + at.pixel);
    P value(0);
    for (int k = 0; k < 3; ++k) {
      const P g = P::load(gradients->planes[k] + at.pixel);
      value = fma(g, color[k], value);
      sums.color[k] = fma(step.weight, g, sums.color[k]);
    }
    if constexpr (kExtra) {
      const P g_depth = P::load(gradients->planes[kPlanes - 1] + at.pixel);
      value = fma(g_depth, depth, value) + P::load(gradients->planes[kPlanes - 2] + at.pixel);
      sums.depth = fma(step.weight, g_depth, sums.depth);
    }
    P behind = P::load(gradients->behind + at.pixel);
    const P u = m::blend_step_adjoint<m::PlainArithmetic, kSmooth>(step, value, max_alpha, &behind);
    behind.store(gradients->behind + at.pixel);
    sums.add(u, dx, dy);
  });
  return sums;
}

/// dL/dbackground = Σ dL/dC T_end, after the last splat.
template <class P, bool kExtra, class T = typename P::Scalar>
JADE_HD void add_background(const TileState<P>& state, const TileGradients<P, kExtra>& gradients,
                            T* grad_background) {
  for (int c = 0; c < 3; ++c) {
    P total(0);
    for (int p = 0; p < TileState<P>::kSize; p += P::kLanes) {
      total =
          fma(P::load(gradients.planes[c] + p), m::abs(P::load(state.transmittance + p)), total);
    }
    grad_background[c] += sum(total);
  }
}

template <class P, bool kSmooth, bool kExtra, class T = typename P::Scalar>
void blend_tile_adjoint(const RenderCall<T>& call, const Tile<T>& tile, const Images<T>& images,
                        const ImageGradients<T>& image_gradients, T* instances,
                        T* grad_background) {
  TileState<P> state;
  state.reset(tile);
  TileGradients<P, kExtra> gradients(call, tile, images, image_gradients);
  const int values = instance_values(call.depth);
  const int column = tile.x0 >> call.tile_shift, row = tile.y0 >> call.tile_shift;
  const auto sums_of = [&](const Splat<T>& splat) {
    const int64_t place = TileBox(splat, call.tile_shift).place(column, row);
    return instances + (splat.slot + place) * values;
  };
  SplatBatch<P> batch;
  const P max_alpha(call.max_alpha);
  int64_t next = 0;
  for (; next < tile.list_size && state.any_live(); next += batch.size) {
    batch.take(tile, next, state.live);
    // Slots are in the order of the index, so each of these stores would miss the cache.
    for (int k = 0; k < batch.size; ++k) __builtin_prefetch(sums_of(*batch.splats[k]), 1);
    for (int k = 0; k < batch.size; ++k) {
      const Splat<T>& splat = *batch.splats[k];
      replay_splat<kSmooth>(splat, batch.blocks[k], max_alpha, &state, &gradients)
          .store(call.depth, sums_of(splat));
    }
    state.find_live();
  }
  for (; next < tile.list_size; ++next) {
    T* const out = sums_of(tile.splats[tile.list[next]]);
    for (int k = 0; k < values; ++k) out[k] = 0;
  }
  if (image_gradients.color != nullptr) add_background(state, gradients, grad_background);
}

template <class P, class T = typename P::Scalar>
void blend_adjoint(const RenderCall<T>& call, const Tile<T>& tile, const Images<T>& images,
                   const ImageGradients<T>& gradients, T* instances, T* grad_background) {
  const bool extra = gradients.alpha != nullptr || gradients.depth_sum != nullptr;
  const auto run =
      call.smooth_cutoff
          ? (extra ? blend_tile_adjoint<P, true, true, T> : blend_tile_adjoint<P, true, false, T>)
          : (extra ? blend_tile_adjoint<P, false, true, T>
                   : blend_tile_adjoint<P, false, false, T>);
  run(call, tile, images, gradients, instances, grad_background);
}

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
