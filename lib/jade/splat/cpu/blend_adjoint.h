// SPDX-License-Identifier: Apache-2.0
// From the gradients of a tile's pixels to sums per splat: replays the blending, see math/blend.h.
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

/// dL/dpixel of a tile and what is still behind the splats so far. kExtra: gradients of alpha or
/// depth take part.
template <class P, bool kExtra>
struct TileGradients {
  using T = typename P::Scalar;
  static constexpr int kStride = TileState<P>::kStride;
  static constexpr int kPlanes = kExtra ? 5 : 3;  ///< dL/dcolour, dL/dalpha, dL/ddepth

  alignas(64) T behind[TileState<P>::kSize];
  alignas(64) T planes[kPlanes][TileState<P>::kSize];

  JADE_HD TileGradients(const RenderCall<T>& call, const Tile<T>& tile, const Images<T>& images,
                        const ImageGradients<T>& gradients) {
    std::memset(behind, 0, sizeof(T) * kStride * tile.height);
    for (auto& plane : planes) std::memset(plane, 0, sizeof(T) * kStride * tile.height);
    const int64_t plane_size = static_cast<int64_t>(call.width) * call.height;
    for (int y = 0; y < tile.height; ++y) {
      const int64_t row = static_cast<int64_t>(tile.y0 + y) * call.width + tile.x0;
      for (int k = 0; k < kPlanes; ++k) {
        const T* const grad = k < 3 ? (gradients.color ? gradients.color + k * plane_size : nullptr)
                                    : (k == 3 ? gradients.alpha : gradients.depth_sum);
        const T* const image =
            k < 3 ? images.color + k * plane_size : (k == 3 ? images.alpha : images.depth_sum);
        if (grad == nullptr) continue;
        for (int x = 0; x < tile.width; ++x) {
          const T g = grad[row + x];
          planes[k][y * kStride + x] = g;
          behind[y * kStride + x] += g * image[row + x];
        }
      }
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
    out[0] = sum(moments.u);
    out[1] = sum(moments.x);
    out[2] = sum(moments.y);
    out[3] = sum(moments.xx);
    out[4] = sum(moments.xy);
    out[5] = sum(moments.yy);
    for (int k = 0; k < 3; ++k) out[6 + k] = sum(color[k]);
    if (with_depth) out[9] = sum(depth);
  }
};

/// Replays one splat on the pixels that it may cover.
template <bool kSmooth, class P, bool kExtra, class T = typename P::Scalar>
JADE_HD LaneSums<P> replay_splat(const Splat<T>& splat, const PackList<P>& packs,
                                 TileState<P>* state, TileGradients<P, kExtra>* gradients) {
  constexpr int kPlanes = TileGradients<P, kExtra>::kPlanes;
  const P center(splat.x), a(splat.a), depth(splat.depth);
  const P color[3] = {P(splat.color[0]), P(splat.color[1]), P(splat.color[2])};
  LaneSums<P> sums;
  for (int n = 0; n < packs.count; ++n) {
    const PackPlace<P> at(packs.places[n]);
    const P dx = P::load(state->center_x + at.x) - center, dy(packs.dy[at.y]);
    P t = P::load(state->transmittance + at.pixel);
    const auto step =
        m::blend_step<m::PlainArithmetic, kSmooth>(m::exponent(packs.row(a, at.y), dx), &t);
    t.store(state->transmittance + at.pixel);
    state->keep_live(at.y, at.x, bits(step.goes_on));
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
    const P u = m::blend_step_adjoint<m::PlainArithmetic, kSmooth>(step, value, &behind);
    behind.store(gradients->behind + at.pixel);
    sums.add(u, dx, dy);
  }
  return sums;
}

/// dL/dbackground = Σ dL/dC T_end, after the last splat.
template <class P, bool kExtra, class T = typename P::Scalar>
JADE_HD void add_background(const Tile<T>& tile, const TileState<P>& state,
                            const TileGradients<P, kExtra>& gradients, T* grad_background) {
  for (int c = 0; c < 3; ++c) {
    T total(0);
    for (int y = 0; y < tile.height; ++y) {
      for (int x = 0; x < tile.width; ++x) {
        const int p = y * TileState<P>::kStride + x;
        total += gradients.planes[c][p] * m::abs(state.transmittance[p]);
      }
    }
    grad_background[c] += total;
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
  PackList<P> packs;
  for (int64_t i = 0; i < tile.list_size; ++i) {
    const Splat<T>& splat = tile.splats[tile.list[i]];
    if (i + 2 < tile.list_size) __builtin_prefetch(tile.splats + tile.list[i + 2]);
    T* const out =
        instances + (splat.slot + TileBox(splat, call.tile_shift).place(column, row)) * values;
    if (!state.any_live()) {
      for (int k = 0; k < values; ++k) out[k] = 0;
      continue;
    }
    packs.build(splat, tile, state.live);
    replay_splat<kSmooth>(splat, packs, &state, &gradients).store(call.depth, out);
  }
  if (image_gradients.color != nullptr) add_background(tile, state, gradients, grad_background);
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
