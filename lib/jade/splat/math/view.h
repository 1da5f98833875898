// SPDX-License-Identifier: Apache-2.0
// Gradients of a Gaussian and of the camera from the pixels of one view.
#pragma once

#include "jade/splat/math/blend.h"
#include "jade/splat/math/projection.h"
#include "jade/splat/math/scalar.h"
#include "jade/splat/math/sh.h"

namespace jade::splat::math {
inline namespace JADE_ISA {

/// A Gaussian projected into a view, and the sums over the view's pixels.
template <class S>
struct Drawn {
  decltype(S(0) > S(0)) visible;
  Falloff<S> falloff;
  S color[3];
  Moments<S> moments;
  S grad_color[3];
  S grad_depth;  ///< 0 unless depth is rendered
};

/// Reads sums in the order of kPixelSums.
template <class S>
JADE_HD void set_sums(const S* sums, bool with_depth, Drawn<S>* drawn) {
  drawn->moments = {sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]};
  for (int c = 0; c < 3; ++c) drawn->grad_color[c] = sums[6 + c];
  drawn->grad_depth = with_depth ? sums[kPixelSums] : S(0);
}

/// Settings of a view.
template <class S>
struct View {
  const Camera<S>& camera;
  int sh_degree;
  bool antialiased;
};

/// Contribution of a view to the coefficients: dL/dsh is the outer product of the basis at
/// `direction` and `color`, which is dL/dcolour before the clamp.
template <class S>
struct ShGradient {
  S direction[3], color[3];
};

/// Adjoint of project(), make_falloff() and view_color() together, except for the coefficients,
/// which get `on_sh`. `sh` is [K,3]. Adds to *grad and *grad_camera, and returns the gradient on
/// the screen. If the Gaussian is not visible, the results are undefined.
template <class S>
JADE_HD ScreenGradient<S> view_adjoint(const View<S>& view, const Shape<S>& shape, const S* sh,
                                       const Drawn<S>& drawn, ShapeGradient<S>* grad,
                                       ShGradient<S>* on_sh, CameraGradient<S>* grad_camera) {
  const Camera<S>& camera = view.camera;
  ScreenGradient<S> on_screen;
  falloff_adjoint(drawn.falloff, drawn.moments, &on_screen.x, &on_screen.y, &on_screen.cov_xx,
                  &on_screen.cov_xy, &on_screen.cov_yy);
  on_screen.log_opacity = drawn.moments.u;
  on_screen.depth = drawn.grad_depth;
  project_adjoint(shape, camera, view.antialiased, on_screen, grad, grad_camera);
  S* const direction = on_sh->direction;
  S grad_basis[16], grad_direction[3] = {S(0), S(0), S(0)};
  const S inverse_norm = view_direction(shape.mean, camera, direction);
  clamp_adjoint(view.sh_degree, drawn.color, drawn.grad_color, on_sh->color);
  sh_basis_gradient(view.sh_degree, sh, on_sh->color, grad_basis);
  sh_basis_adjoint(view.sh_degree, direction, grad_basis, grad_direction);
  view_direction_adjoint(direction, inverse_norm, grad_direction, camera, grad->mean, grad_camera);
  return on_screen;
}

}  // namespace JADE_ISA
}  // namespace jade::splat::math
