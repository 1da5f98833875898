// SPDX-License-Identifier: Apache-2.0
// Projects Gaussians to splats, one per lane of a pack.
#pragma once

#include <cstdint>
#include <cstring>

#include "jade/splat/cpu/lanes.h"
#include "jade/splat/math/projection.h"
#include "jade/splat/math/sh.h"
#include "jade/splat/math/tile.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

/// floor(value) + 1 for value ≥ −1, at least 0 and at most `limit`.
template <class T>
JADE_HD int16_t count_up_to(T value, int limit) {
  if (!(value >= T(0))) return 0;
  if (value >= T(limit)) return static_cast<int16_t>(limit);
  return static_cast<int16_t>(static_cast<int>(value) + 1);
}

constexpr int kSplatValues = 13;  ///< of a Splat, before its box
constexpr int kBoxValues = 4;     ///< low and high end in x, then in y: pixel i is in (low, high]

/// Writes one splat per lane in use; invisible ones get an empty box.
template <class P, class T = typename P::Scalar>
JADE_HD void store_splats(const RenderCall<T>& call, const P* values, uint32_t visible, int lanes,
                          Splat<T>* out) {
  alignas(64) T lane_values[kSplatValues + kBoxValues][P::kLanes];
  for (int k = 0; k < kSplatValues + kBoxValues; ++k) values[k].store(lane_values[k]);
  for (int l = 0; l < lanes; ++l) {
    Splat<T> splat{};
    if (visible >> l & 1) {
      T copy[kSplatValues];
      for (int k = 0; k < kSplatValues; ++k) copy[k] = lane_values[k][l];
      std::memcpy(&splat, copy, sizeof(copy));
      const T* const box = &lane_values[kSplatValues][l];
      splat.x0 = count_up_to(box[0], call.width);
      splat.x1 = count_up_to(box[P::kLanes], call.width);
      splat.y0 = count_up_to(box[2 * P::kLanes], call.height);
      splat.y1 = count_up_to(box[3 * P::kLanes], call.height);
      if (splat.x0 >= splat.x1 || splat.y0 >= splat.y1) splat = Splat<T>{};
    }
    out[l] = splat;
  }
}

/// One view of the block's Gaussians.
template <class P, class T = typename P::Scalar>
JADE_HD void project_view(const RenderCall<T>& call, const LaneBlock<P>& block,
                          const m::Shape<P>& shape, P shape_log2_opacity, int view, Splat<T>* out) {
  const m::Camera<P> camera = load_camera<P>(call, view);
  const m::Screen<P> screen = m::project(shape, camera, call.antialiased);
  auto visible = block.usable & m::is_drawable(screen, P(call.near_plane), P(call.far_plane));
  if (bits(visible) == 0) {
    for (int l = 0; l < block.lanes; ++l) out[l] = Splat<T>{};
    return;
  }
  P color[3];
  m::view_color(call.sh_degree, shape.mean, camera, block.sh, color);
  for (int c = 0; c < 3; ++c) visible = visible & m::within(color[c], P(m::kMaxColor));
  const P log2_opacity = call.antialiased ? log2(screen.opacity) : shape_log2_opacity;
  const P reach = m::reach(log2_opacity);
  visible = visible & (reach > P(0));
  const P half_x = m::half_extent(reach, screen.cov_xx);
  const P half_y = m::half_extent(reach, screen.cov_yy);
  const auto falloff = m::make_falloff(screen.cov_xx, screen.cov_xy, screen.cov_yy, screen.det);
  const auto row = m::make_row_extent(reach, screen.cov_xy, screen.cov_yy, screen.det);
  const P half(T(0.5));
  const P values[kSplatValues + kBoxValues] = {
      screen.x, screen.y, falloff.a, falloff.b, falloff.c, log2_opacity, color[0], color[1],
      color[2], screen.depth, row.slope, row.width2, row.shrink,
      // The splat reaches pixel i if i + ½ is within its extent.
      screen.x - half_x - half, screen.x + half_x - half, screen.y - half_y - half,
      screen.y + half_y - half};
  store_splats(call, values, bits(visible), block.lanes, out);
}

template <class P, class T = typename P::Scalar>
int64_t project(const RenderCall<T>& call, int64_t begin, int64_t end, Splat<T>* splats) {
  int64_t unusable = 0;
  LaneBlock<P> block;
  for (int64_t first = begin; first < end; first += P::kLanes) {
    load_block(call, first, end, &block);
    const uint32_t all = (1u << block.lanes) - 1;
    unusable += __builtin_popcount(all & ~bits(block.usable));
    const m::Shape<P> shape = m::activate(block.raw, call.activated);
    const P log2_opacity = log2(shape.opacity);
    for (int view = 0; view < call.views; ++view) {
      project_view(call, block, shape, log2_opacity, view, splats + view * call.count + first);
    }
  }
  return unusable;
}

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
