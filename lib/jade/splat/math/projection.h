// SPDX-License-Identifier: Apache-2.0
// Projection of a Gaussian to an ellipse on the screen, and its adjoint.
#pragma once

#include <cstdint>

#include "jade/splat/math/scalar.h"

namespace jade::splat::math {
inline namespace JADE_ISA {

constexpr double kDilationPx2 = 0.3;       ///< added to both variances on the screen
constexpr double kFrustumMargin = 0.3;     ///< relative to the half field of view, beyond each edge
constexpr double kMaxAbsLogScale = 30;     ///< beyond this a Gaussian is rejected
constexpr double kMaxAbsScale = 1e13;      ///< likewise
constexpr double kMaxAbsMean = 1e12;       ///< likewise
constexpr double kMaxAbsLogit = 1e4;       ///< likewise
constexpr double kMaxOpacity = 1e4;        ///< likewise, of an opacity that is given as such
constexpr double kMinQuaternion2 = 1e-24;  ///< smallest squared norm of a rotation
constexpr double kMaxCovariance = 1e12;    ///< px²; a larger ellipse is culled

/// One view. x_camera = rotation · x_world + translation.
template <class S>
struct Camera {
  S rotation[9];  ///< row-major
  S translation[3];
  S fx, fy, cx, cy;
  S center[3];                   ///< in the world: −rotationᵀ · translation
  S x_min, x_max, y_min, y_max;  ///< range of x/z and y/z in which the Jacobian is evaluated
};

/// fx, fy, cx, cy of a view, from rows of these four or from matrices [3,3].
template <class T>
JADE_HD void load_intrinsics(const T* intrinsics, bool matrices, int64_t view, T* out) {
  const T* const from = intrinsics + (matrices ? 9 : 4) * view;
  out[0] = from[0];
  out[1] = from[matrices ? 4 : 1];
  out[2] = from[2];
  out[3] = from[matrices ? 5 : 3];
}

/// Camera from row-major `camera_from_world` [4,4] and fx, fy, cx, cy. Works for T ≠ S.
template <class S, class T>
JADE_HD Camera<S> make_camera(const T* camera_from_world, const T* intrinsics, int width,
                              int height) {
  const T* const m = camera_from_world;
  Camera<S> camera;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) camera.rotation[3 * i + j] = S(m[4 * i + j]);
    camera.translation[i] = S(m[4 * i + 3]);
  }
  for (int j = 0; j < 3; ++j) {
    camera.center[j] = S(-(m[j] * m[3] + m[4 + j] * m[7] + m[8 + j] * m[11]));
  }
  const T fx = intrinsics[0], fy = intrinsics[1], cx = intrinsics[2], cy = intrinsics[3];
  camera.fx = S(fx);
  camera.fy = S(fy);
  camera.cx = S(cx);
  camera.cy = S(cy);
  const T margin_x = T(kFrustumMargin) * T(0.5) * T(width) / fx;
  const T margin_y = T(kFrustumMargin) * T(0.5) * T(height) / fy;
  camera.x_min = S(-(cx / fx + margin_x));
  camera.x_max = S((T(width) - cx) / fx + margin_x);
  camera.y_min = S(-(cy / fy + margin_y));
  camera.y_max = S((T(height) - cy) / fy + margin_y);
  return camera;
}

/// A Gaussian after its activations, independent of the view.
template <class S>
struct Shape {
  S mean[3];
  S axes[9];      ///< M = R(q) · diag(scale), row-major; Σ = M Mᵀ
  S rotation[9];  ///< R(q)
  S scale[3];
  S opacity;
};

/// dL/d of a Shape, summed over views; `log_opacity` is dL/d ln(opacity).
template <class S>
struct ShapeGradient {
  S mean[3], axes[9], log_opacity;
};

/// Parameters as stored. If `activated` is true below, the last two are the scales and the opacity
/// themselves.
template <class S>
struct RawShape {
  S mean[3];
  S quaternion[4];  ///< wxyz
  S log_scale[3];
  S logit_opacity;
};

/// True for parameters that can be rendered; NaN fails every comparison.
template <class S>
JADE_HD auto is_usable(const RawShape<S>& raw, bool activated = false) {
  const S scale_bound(activated ? kMaxAbsScale : kMaxAbsLogScale);
  const S* const q = raw.quaternion;
  const S norm2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  auto usable = within(raw.logit_opacity, S(activated ? kMaxOpacity : kMaxAbsLogit)) &
                (norm2 >= S(kMinQuaternion2)) & (norm2 <= S(1 / kMinQuaternion2));
  for (int i = 0; i < 3; ++i) {
    usable = usable & within(raw.mean[i], S(kMaxAbsMean)) & within(raw.log_scale[i], scale_bound);
  }
  return usable;
}

/// Replaces unusable parameters by those of a unit Gaussian at the origin, which is numerically
/// safe.
template <class S, class Mask>
JADE_HD void replace_unusable(Mask usable, RawShape<S>* raw) {
  for (int k = 0; k < 3; ++k) {
    raw->mean[k] = keep(usable, raw->mean[k]);
    raw->log_scale[k] = keep(usable, raw->log_scale[k]);
  }
  for (int k = 0; k < 4; ++k) raw->quaternion[k] = select(usable, raw->quaternion[k], S(k == 0));
  raw->logit_opacity = keep(usable, raw->logit_opacity);
}

/// Rotation matrix of a unit quaternion wxyz.
template <class S>
JADE_HD void rotation_from_quaternion(const S* q, S* r) {
  const S w = q[0], x = q[1], y = q[2], z = q[3];
  const S one(1), two(2);
  r[0] = one - two * (y * y + z * z);
  r[1] = two * (x * y - w * z);
  r[2] = two * (x * z + w * y);
  r[3] = two * (x * y + w * z);
  r[4] = one - two * (x * x + z * z);
  r[5] = two * (y * z - w * x);
  r[6] = two * (x * z - w * y);
  r[7] = two * (y * z + w * x);
  r[8] = one - two * (x * x + y * y);
}

/// Adjoint: g = dL/dr, writes dL/dq of the unit quaternion.
template <class S>
JADE_HD void rotation_from_quaternion_adjoint(const S* q, const S* g, S* grad_q) {
  const S w = q[0], x = q[1], y = q[2], z = q[3];
  const S two(2);
  grad_q[0] = two * (x * (g[7] - g[5]) + y * (g[2] - g[6]) + z * (g[3] - g[1]));
  grad_q[1] =
      two * (y * (g[1] + g[3]) + z * (g[2] + g[6]) - two * x * (g[4] + g[8]) + w * (g[7] - g[5]));
  grad_q[2] =
      two * (x * (g[1] + g[3]) + z * (g[5] + g[7]) - two * y * (g[0] + g[8]) + w * (g[2] - g[6]));
  grad_q[3] =
      two * (x * (g[2] + g[6]) + y * (g[5] + g[7]) - two * z * (g[0] + g[4]) + w * (g[3] - g[1]));
}

template <class S>
JADE_HD S sigmoid(S x) {
  return S(1) / (S(1) + exp(-x));
}

/// Applies the activations. Call only for usable parameters (or ignore the result).
template <class S>
JADE_HD Shape<S> activate(const RawShape<S>& raw, bool activated = false) {
  Shape<S> shape;
  const S* const q = raw.quaternion;
  const S inverse_norm = S(1) / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const S unit[4] = {q[0] * inverse_norm, q[1] * inverse_norm, q[2] * inverse_norm,
                     q[3] * inverse_norm};
  rotation_from_quaternion(unit, shape.rotation);
  for (int j = 0; j < 3; ++j) {
    shape.mean[j] = raw.mean[j];
    shape.scale[j] = activated ? raw.log_scale[j] : exp(raw.log_scale[j]);
    for (int i = 0; i < 3; ++i) shape.axes[3 * i + j] = shape.rotation[3 * i + j] * shape.scale[j];
  }
  shape.opacity = activated ? raw.logit_opacity : sigmoid(raw.logit_opacity);
  return shape;
}

/// Adjoint of activate(): M = R(q/|q|) diag(e^l), so dL/dl_j = Σ_i dM_ij M_ij and
/// dL/dR_ij = dM_ij s_j; through the norm only the part of dL/d(unit q) across q survives.
/// d ln(o) / d logit = 1 − o. With respect to scales, dL/ds_j = Σ_i dM_ij R_ij.
template <class S>
JADE_HD RawShape<S> activate_adjoint(const RawShape<S>& raw, const Shape<S>& shape,
                                     const ShapeGradient<S>& on_shape, bool activated = false) {
  RawShape<S> grad;
  S grad_rotation[9];
  for (int j = 0; j < 3; ++j) {
    S sum(0);
    for (int i = 0; i < 3; ++i) {
      const int k = 3 * i + j;
      sum = sum + on_shape.axes[k] * (activated ? shape.rotation[k] : shape.axes[k]);
      grad_rotation[k] = on_shape.axes[k] * shape.scale[j];
    }
    grad.log_scale[j] = sum;
    grad.mean[j] = on_shape.mean[j];
  }
  const S* const q = raw.quaternion;
  const S inverse_norm = S(1) / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  S unit[4], grad_unit[4];
  for (int i = 0; i < 4; ++i) unit[i] = q[i] * inverse_norm;
  rotation_from_quaternion_adjoint(unit, grad_rotation, grad_unit);
  const S along = unit[0] * grad_unit[0] + unit[1] * grad_unit[1] + unit[2] * grad_unit[2] +
                  unit[3] * grad_unit[3];
  for (int i = 0; i < 4; ++i) {
    grad.quaternion[i] = (grad_unit[i] - unit[i] * along) * inverse_norm;
  }
  grad.logit_opacity = on_shape.log_opacity * (S(1) - shape.opacity);
  if (activated) {
    grad.logit_opacity = select(shape.opacity > S(0), on_shape.log_opacity / shape.opacity, S(0));
  }
  return grad;
}

/// A projected Gaussian in one view.
template <class S>
struct Screen {
  S x, y, depth;             ///< px, px, camera z
  S cov_xx, cov_xy, cov_yy;  ///< px², dilated
  S det;                     ///< of the dilated covariance
  S opacity;                 ///< after the antialiasing factor
};

/// Intermediate values of project() that its adjoint reads.
template <class S>
struct ProjectionSteps {
  S point[3];            ///< in the camera
  S ratio_x, ratio_y;    ///< x/z and y/z, clamped
  S j00, j02, j11, j12;  ///< Jacobian of the projection: [j00 0 j02; 0 j11 j12]
  S t[6];                ///< J · W, 2×3
  S v[6];                ///< J · W · M, 2×3: cov2d = V Vᵀ
  S inverse_z;
};

/// EWA projection: cov2d = V Vᵀ + 0.3 I with V = J W M. The Jacobian J is evaluated at x/z and y/z
/// clamped to a frustum 0.3 half-fields larger than the image; the mean itself is not clamped.
template <class S>
JADE_HD ProjectionSteps<S> projection_steps(const Shape<S>& shape, const Camera<S>& camera) {
  ProjectionSteps<S> s;
  const S* const w = camera.rotation;
  const S* const m = shape.mean;
  for (int i = 0; i < 3; ++i) {
    s.point[i] =
        w[3 * i] * m[0] + w[3 * i + 1] * m[1] + w[3 * i + 2] * m[2] + camera.translation[i];
  }
  s.inverse_z = S(1) / s.point[2];
  s.ratio_x = min(max(s.point[0] * s.inverse_z, camera.x_min), camera.x_max);
  s.ratio_y = min(max(s.point[1] * s.inverse_z, camera.y_min), camera.y_max);
  s.j00 = camera.fx * s.inverse_z;
  s.j11 = camera.fy * s.inverse_z;
  s.j02 = -s.j00 * s.ratio_x;
  s.j12 = -s.j11 * s.ratio_y;
  for (int k = 0; k < 3; ++k) {
    s.t[k] = s.j00 * w[k] + s.j02 * w[6 + k];
    s.t[3 + k] = s.j11 * w[3 + k] + s.j12 * w[6 + k];
  }
  for (int row = 0; row < 2; ++row) {
    for (int k = 0; k < 3; ++k) {
      s.v[3 * row + k] = s.t[3 * row] * shape.axes[k] + s.t[3 * row + 1] * shape.axes[3 + k] +
                         s.t[3 * row + 2] * shape.axes[6 + k];
    }
  }
  return s;
}

template <class S>
JADE_HD Screen<S> project(const Shape<S>& shape, const Camera<S>& camera, bool antialiased) {
  const ProjectionSteps<S> s = projection_steps(shape, camera);
  Screen<S> screen;
  screen.x = camera.fx * s.point[0] * s.inverse_z + camera.cx;
  screen.y = camera.fy * s.point[1] * s.inverse_z + camera.cy;
  screen.depth = s.point[2];
  const S xx = s.v[0] * s.v[0] + s.v[1] * s.v[1] + s.v[2] * s.v[2];
  const S xy = s.v[0] * s.v[3] + s.v[1] * s.v[4] + s.v[2] * s.v[5];
  const S yy = s.v[3] * s.v[3] + s.v[4] * s.v[4] + s.v[5] * s.v[5];
  const S dilation(kDilationPx2);
  screen.cov_xx = xx + dilation;
  screen.cov_xy = xy;
  screen.cov_yy = yy + dilation;
  // |V Vᵀ| as the squared cross product of V's rows: no cancellation for needles.
  const S c0 = s.v[1] * s.v[5] - s.v[2] * s.v[4];
  const S c1 = s.v[2] * s.v[3] - s.v[0] * s.v[5];
  const S c2 = s.v[0] * s.v[4] - s.v[1] * s.v[3];
  const S bare_det = c0 * c0 + c1 * c1 + c2 * c2;
  screen.det = bare_det + dilation * (xx + yy) + dilation * dilation;
  screen.opacity = shape.opacity;
  if (antialiased) screen.opacity = screen.opacity * sqrt(bare_det / screen.det);
  return screen;
}

/// True if the projection may be rendered: between the planes and of finite, plausible size.
template <class S>
JADE_HD auto is_drawable(const Screen<S>& screen, S near_plane, S far_plane) {
  const S bound(kMaxCovariance);
  return (screen.depth >= near_plane) & (screen.depth <= far_plane) & within(screen.x, bound) &
         within(screen.y, bound) & within(screen.cov_xx, bound) & within(screen.cov_yy, bound) &
         within(screen.opacity, S(kMaxOpacity)) & (screen.det > S(0));
}

/// Gradients of one view's camera.
template <class S>
struct CameraGradient {
  S rotation[9];
  S translation[3];
};

/// dL/d of a Screen; `log_opacity` is dL/d ln(opacity).
template <class S>
struct ScreenGradient {
  S x, y, depth, cov_xx, cov_xy, cov_yy, log_opacity;
};

/// Adjoint of project(). Adds to *grad and *grad_camera. With C = V Vᵀ: dV = (G + Gᵀ) V, where G
/// has half of cov_xy's gradient on each side; then dM = Tᵀ dV, dT = dV Mᵀ, dJ = dT Wᵀ, dW = Jᵀ dT
/// + (dpoint) meanᵀ. A clamped ratio is constant, so J's third column then depends on z alone.
template <class S>
JADE_HD void project_adjoint(const Shape<S>& shape, const Camera<S>& camera, bool antialiased,
                             ScreenGradient<S> g, ShapeGradient<S>* grad,
                             CameraGradient<S>* grad_camera) {
  const ProjectionSteps<S> s = projection_steps(shape, camera);
  const S two(2);
  if (antialiased) {
    // ln factor = ½ (ln d − ln D), d = |V Vᵀ|, D = d + δ (xx + yy) + δ².
    const S dilation(kDilationPx2);
    const S xx = s.v[0] * s.v[0] + s.v[1] * s.v[1] + s.v[2] * s.v[2];
    const S xy = s.v[0] * s.v[3] + s.v[1] * s.v[4] + s.v[2] * s.v[5];
    const S yy = s.v[3] * s.v[3] + s.v[4] * s.v[4] + s.v[5] * s.v[5];
    const S c0 = s.v[1] * s.v[5] - s.v[2] * s.v[4];
    const S c1 = s.v[2] * s.v[3] - s.v[0] * s.v[5];
    const S c2 = s.v[0] * s.v[4] - s.v[1] * s.v[3];
    const S bare_det = c0 * c0 + c1 * c1 + c2 * c2;
    const S det = bare_det + dilation * (xx + yy) + dilation * dilation;
    const S half_g = S(0.5) * g.log_opacity;
    const S on_bare = select(bare_det > S(0), half_g / bare_det, S(0)) - half_g / det;
    const S on_trace = -half_g * dilation / det;
    g.cov_xx = g.cov_xx + on_bare * yy + on_trace;
    g.cov_yy = g.cov_yy + on_bare * xx + on_trace;
    g.cov_xy = g.cov_xy - two * on_bare * xy;
  }
  S grad_v[6];
  for (int k = 0; k < 3; ++k) {
    grad_v[k] = two * g.cov_xx * s.v[k] + g.cov_xy * s.v[3 + k];
    grad_v[3 + k] = g.cov_xy * s.v[k] + two * g.cov_yy * s.v[3 + k];
  }
  S grad_t[6];
  for (int i = 0; i < 3; ++i) {
    const S* const axes = shape.axes + 3 * i;
    for (int k = 0; k < 3; ++k) {
      grad->axes[3 * i + k] =
          grad->axes[3 * i + k] + s.t[i] * grad_v[k] + s.t[3 + i] * grad_v[3 + k];
    }
    grad_t[i] = grad_v[0] * axes[0] + grad_v[1] * axes[1] + grad_v[2] * axes[2];
    grad_t[3 + i] = grad_v[3] * axes[0] + grad_v[4] * axes[1] + grad_v[5] * axes[2];
  }
  const S* const w = camera.rotation;
  const S g00 = grad_t[0] * w[0] + grad_t[1] * w[1] + grad_t[2] * w[2];
  const S g02 = grad_t[0] * w[6] + grad_t[1] * w[7] + grad_t[2] * w[8];
  const S g11 = grad_t[3] * w[3] + grad_t[4] * w[4] + grad_t[5] * w[5];
  const S g12 = grad_t[3] * w[6] + grad_t[4] * w[7] + grad_t[5] * w[8];
  const S raw_x = s.point[0] * s.inverse_z, raw_y = s.point[1] * s.inverse_z;
  const S grad_ratio_x =
      select((raw_x > camera.x_min) & (raw_x < camera.x_max), -s.j00 * g02, S(0));
  const S grad_ratio_y =
      select((raw_y > camera.y_min) & (raw_y < camera.y_max), -s.j11 * g12, S(0));
  // j00 = fx/z and j02 = −fx ratio/z: both are proportional to 1/z at a fixed ratio.
  const S grad_x = (grad_ratio_x + camera.fx * g.x) * s.inverse_z;
  const S grad_y = (grad_ratio_y + camera.fy * g.y) * s.inverse_z;
  const S grad_point[3] = {
      grad_x, grad_y,
      g.depth - raw_x * grad_x - raw_y * grad_y -
          s.inverse_z * (s.j00 * g00 + s.j02 * g02 + s.j11 * g11 + s.j12 * g12)};
  for (int k = 0; k < 3; ++k) {
    grad->mean[k] =
        grad->mean[k] + w[k] * grad_point[0] + w[3 + k] * grad_point[1] + w[6 + k] * grad_point[2];
    grad_camera->translation[k] = grad_camera->translation[k] + grad_point[k];
    grad_camera->rotation[k] =
        grad_camera->rotation[k] + s.j00 * grad_t[k] + grad_point[0] * shape.mean[k];
    grad_camera->rotation[3 + k] =
        grad_camera->rotation[3 + k] + s.j11 * grad_t[3 + k] + grad_point[1] * shape.mean[k];
    grad_camera->rotation[6 + k] = grad_camera->rotation[6 + k] + s.j02 * grad_t[k] +
                                   s.j12 * grad_t[3 + k] + grad_point[2] * shape.mean[k];
  }
  grad->log_opacity = grad->log_opacity + g.log_opacity;
}

/// 3 σ of the longer axis of the dilated ellipse, px.
template <class S>
JADE_HD S screen_radius(const Shape<S>& shape, const Camera<S>& camera) {
  const Screen<S> screen = project(shape, camera, false);
  const S mid = S(0.5) * (screen.cov_xx + screen.cov_yy);
  return S(3) * sqrt(mid + sqrt(max(mid * mid - screen.det, S(0))));
}

/// ‖dL/dmean2d‖ with mean2d in NDC, px · 2 / image size.
template <class S>
JADE_HD S ndc_gradient_norm(const ScreenGradient<S>& g, int width, int height) {
  const S x = g.x * (S(0.5) * S(width)), y = g.y * (S(0.5) * S(height));
  return sqrt(x * x + y * y);
}

}  // namespace JADE_ISA
}  // namespace jade::splat::math
