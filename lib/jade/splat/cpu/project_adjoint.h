// SPDX-License-Identifier: Apache-2.0
// Computes the gradients of the Gaussians and cameras from the sums over pixels.
#pragma once

#include <cstdint>

#include "jade/splat/cpu/lanes.h"
#include "jade/splat/cpu/tile_box.h"
#include "jade/splat/math/blend.h"
#include "jade/splat/math/projection.h"
#include "jade/splat/math/sh.h"
#include "jade/splat/math/view.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

/// Gradient of a block's Gaussians, summed over the views so far.
template <class P>
struct BlockGradient {
  m::ShapeGradient<P> shape;
  P sh[48];
  P norm, visible, radius;  ///< statistics

  JADE_HD BlockGradient() : shape{}, norm(0), visible(0), radius(0) {
    for (P& g : sh) g = P(0);
  }
};

/// Sums over all tiles for one view of the block's Gaussians. Returns whether any of them is
/// visible.
template <class P, class T = typename P::Scalar>
JADE_HD bool load_drawn(const RenderCall<T>& call, const LaneBlock<P>& block,
                        const Instances<T>& instances, int view, m::Drawn<P>* drawn) {
  constexpr int kLanes = P::kLanes;
  const Splat<T>* const seen = instances.splats + view * call.count + block.first;
  const int values = instance_values(call.depth);
  alignas(64) T sums[m::kPixelSums + 1][kLanes] = {};
  alignas(64) T splat_values[6][kLanes] = {};  // a, b, c, colour
  alignas(64) T shown[kLanes] = {};
  bool any = false;
  for (int l = 0; l < block.lanes; ++l) {
    const Splat<T>& splat = seen[l];
    if (splat.x0 >= splat.x1) continue;
    any = true;
    shown[l] = 1;
    splat_values[0][l] = splat.a;
    splat_values[1][l] = splat.b;
    splat_values[2][l] = splat.c;
    for (int c = 0; c < 3; ++c) splat_values[3 + c][l] = splat.color[c];
    const T* source = instances.sums + (instances.view_offsets[view] + splat.slot) * values;
    T total[m::kPixelSums + 1] = {};
    const int64_t count = TileBox(splat, call.tile_shift).count();
    for (int64_t i = 0; i < count; ++i, source += values) {
      for (int k = 0; k < m::kPixelSums; ++k) total[k] += source[k];
      if (call.depth) total[m::kPixelSums] += source[m::kPixelSums];
    }
    for (int k = 0; k <= m::kPixelSums; ++k) sums[k][l] = total[k];
  }
  const auto load = [](const T* lane_values) { return P::load(lane_values); };
  P loaded[m::kPixelSums + 1];
  for (int k = 0; k <= m::kPixelSums; ++k) loaded[k] = load(sums[k]);
  m::set_sums(loaded, true, drawn);
  drawn->visible = load(shown) > P(0);
  drawn->falloff = {load(splat_values[0]), load(splat_values[1]), load(splat_values[2])};
  for (int c = 0; c < 3; ++c) drawn->color[c] = load(splat_values[3 + c]);
  return any;
}

/// Adds a pack's camera gradients to `sums` [kCameraValues, kMaxLanes].
template <class P, class T = typename P::Scalar>
JADE_HD void add_camera(typename P::Mask visible, const m::CameraGradient<P>& on_camera, T* sums) {
  for (int k = 0; k < kCameraValues; ++k) {
    const P g = k < 9 ? on_camera.rotation[k] : on_camera.translation[k - 9];
    T* const target = sums + k * kMaxLanes;
    (P::load(target) + keep(visible, g)).store(target);
  }
}

/// Writes dL/dmean2d of the visible lanes to their rows of `out`.
template <class P, class T = typename P::Scalar>
JADE_HD void store_means2d(const LaneBlock<P>& block, const m::Drawn<P>& drawn,
                           const m::ScreenGradient<P>& on_screen, T* out) {
  alignas(64) T x[P::kLanes], y[P::kLanes];
  on_screen.x.store(x);
  on_screen.y.store(y);
  const uint32_t visible = bits(drawn.visible);
  for (int l = 0; l < block.lanes; ++l) {
    if ((visible >> l & 1) == 0) continue;
    out[2 * (block.first + l)] = x[l];
    out[2 * (block.first + l) + 1] = y[l];
  }
}

/// Adds one view's part to the block's gradient and to the view's `camera_sums`. `means2d` [count,
/// 2] is the view's, or null.
template <class P, class T = typename P::Scalar>
JADE_HD void add_view(const RenderCall<T>& call, const LaneBlock<P>& block,
                      const m::Shape<P>& shape, const m::Drawn<P>& drawn, int view,
                      bool with_statistics, T* means2d, BlockGradient<P>* sum, T* camera_sums) {
  const m::Camera<P> camera = load_camera<P>(call, view);
  m::ShapeGradient<P> on_shape{};
  m::CameraGradient<P> on_camera{};
  m::ShGradient<P> on_sh;
  const m::ScreenGradient<P> on_screen =
      m::view_adjoint({camera, call.sh_degree, call.antialiased}, shape, block.sh, drawn, &on_shape,
                      &on_sh, &on_camera);
  P basis[16];
  m::sh_basis(call.sh_degree, on_sh.direction, basis);
  const int count = m::sh_count(call.sh_degree);
  for (int k = 0; k < count; ++k) basis[k] = keep(drawn.visible, basis[k]);
  m::add_sh_gradient(0, count, basis, on_sh.color, sum->sh);
  for (int k = 0; k < 3; ++k) {
    sum->shape.mean[k] = sum->shape.mean[k] + keep(drawn.visible, on_shape.mean[k]);
  }
  for (int k = 0; k < 9; ++k) {
    sum->shape.axes[k] = sum->shape.axes[k] + keep(drawn.visible, on_shape.axes[k]);
  }
  sum->shape.log_opacity = sum->shape.log_opacity + keep(drawn.visible, on_shape.log_opacity);
  add_camera(drawn.visible, on_camera, camera_sums);
  if (means2d != nullptr) store_means2d(block, drawn, on_screen, means2d);
  if (!with_statistics) return;
  const P norm = m::ndc_gradient_norm(on_screen, call.width, call.height);
  const P radius = m::screen_radius(shape, camera);
  sum->norm = sum->norm + keep(drawn.visible, norm);
  sum->visible = sum->visible + keep(drawn.visible, P(1));
  sum->radius = max(sum->radius, keep(drawn.visible, radius));
}

/// Writes the gradients of the block's Gaussians; coefficients above the active degree get 0.
template <class P, class T = typename P::Scalar>
JADE_HD void store_gradients(const RenderCall<T>& call, const LaneBlock<P>& block,
                             const m::RawShape<P>& grad, const P* grad_sh,
                             const Gradients<T>& out) {
  const int64_t first = block.first;
  store_lanes<3>(out.means, 3, first, block.lanes, grad.mean);
  store_lanes<4>(out.rotations, 4, first, block.lanes, grad.quaternion);
  store_lanes<3>(out.log_scales, 3, first, block.lanes, grad.log_scale);
  store_lanes<1>(out.logit_opacities, 1, first, block.lanes, &grad.logit_opacity);
  const int stride = 3 * call.sh_stride;
  with_coefficients(call.sh_degree, [&](auto count) {
    store_lanes<decltype(count)::value>(out.sh, stride, first, block.lanes, grad_sh);
  });
  for (int l = 0; l < block.lanes; ++l) {
    T* const row = out.sh + (first + l) * stride;
    for (int k = 3 * m::sh_count(call.sh_degree); k < stride; ++k) row[k] = 0;
  }
}

template <class P, class T = typename P::Scalar>
JADE_HD void add_statistics(const LaneBlock<P>& block, const BlockGradient<P>& sum,
                            const Gradients<T>& out) {
  alignas(64) T norm[P::kLanes], visible[P::kLanes], radius[P::kLanes];
  sum.norm.store(norm);
  sum.visible.store(visible);
  sum.radius.store(radius);
  for (int l = 0; l < block.lanes; ++l) {
    const int64_t i = block.first + l;
    out.gradient_norm[i] += static_cast<float>(norm[l]);
    out.visible_count[i] += static_cast<float>(visible[l]);
    const float seen = static_cast<float>(radius[l]);
    if (seen > out.max_radius_px[i]) out.max_radius_px[i] = seen;
  }
}

template <class P, class T = typename P::Scalar>
void project_adjoint(const RenderCall<T>& call, int64_t begin, int64_t end,
                     const Instances<T>& instances, const Gradients<T>& gradients,
                     T* grad_cameras) {
  const bool statistics = gradients.gradient_norm != nullptr;
  LaneBlock<P> block;
  for (int64_t first = begin; first < end; first += P::kLanes) {
    load_block(call, first, end, &block);
    const m::Shape<P> shape = m::activate(block.raw, call.activated);
    BlockGradient<P> sum;
    for (int view = 0; view < call.views; ++view) {
      m::Drawn<P> drawn;
      if (!load_drawn(call, block, instances, view, &drawn)) continue;
      const bool counts = gradients.statistics_views < 0 || view < gradients.statistics_views;
      T* const means2d =
          gradients.means2d != nullptr ? gradients.means2d + 2 * view * call.count : nullptr;
      add_view(call, block, shape, drawn, view, statistics && counts, means2d, &sum,
               grad_cameras + int64_t{view} * kCameraValues * kMaxLanes);
    }
    const m::RawShape<P> grad = m::activate_adjoint(block.raw, shape, sum.shape, call.activated);
    store_gradients(call, block, grad, sum.sh, gradients);
    if (statistics) add_statistics(block, sum, gradients);
  }
}

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
