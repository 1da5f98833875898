// SPDX-License-Identifier: Apache-2.0
// Colour by direction: real spherical harmonics up to degree 3, in the order and with the signs of
// the standard 3DGS file.
#pragma once

#include "jade/splat/math/projection.h"
#include "jade/splat/math/scalar.h"

namespace jade::splat::math {
inline namespace JADE_ISA {

/// A value of `degree`: the single coefficient is the colour itself, of any sign.
constexpr int kPlainColor = -1;

JADE_HD constexpr int sh_count(int degree) {
  return degree == kPlainColor ? 1 : (degree + 1) * (degree + 1);
}

// Normalisation constants: sqrt of rational multiples of 1/π.
constexpr double kSh0 = 0.28209479177387814;   // ½ √(1/π)
constexpr double kSh1 = 0.4886025119029199;    // ½ √(3/π)
constexpr double kSh2a = 1.0925484305920792;   // ½ √(15/π)
constexpr double kSh2b = 0.31539156525252005;  // ¼ √(5/π)
constexpr double kSh2c = 0.5462742152960396;   // ¼ √(15/π)
constexpr double kSh3a = 0.5900435899266435;   // ¼ √(35/2π)
constexpr double kSh3b = 2.890611442640554;    // ½ √(105/π)
constexpr double kSh3c = 0.4570457994644658;   // ¼ √(21/2π)
constexpr double kSh3d = 0.3731763325901154;   // ¼ √(7/π)
constexpr double kSh3e = 1.445305721320277;    // ¼ √(105/π)

constexpr double kMaxColor = 1e30;  ///< a brighter splat is culled

/// The (degree+1)² basis functions at the unit direction d.
template <class S>
JADE_HD void sh_basis(int degree, const S* d, S* basis) {
  basis[0] = S(degree == kPlainColor ? 1 : kSh0);
  if (degree < 1) return;
  const S x = d[0], y = d[1], z = d[2];
  basis[1] = S(-kSh1) * y;
  basis[2] = S(kSh1) * z;
  basis[3] = S(-kSh1) * x;
  if (degree < 2) return;
  const S xx = x * x, yy = y * y, zz = z * z;
  basis[4] = S(kSh2a) * x * y;
  basis[5] = S(-kSh2a) * y * z;
  basis[6] = S(kSh2b) * (S(2) * zz - xx - yy);
  basis[7] = S(-kSh2a) * x * z;
  basis[8] = S(kSh2c) * (xx - yy);
  if (degree < 3) return;
  const S ring = S(4) * zz - xx - yy;
  basis[9] = S(-kSh3a) * y * (S(3) * xx - yy);
  basis[10] = S(kSh3b) * x * y * z;
  basis[11] = S(-kSh3c) * y * ring;
  basis[12] = S(kSh3d) * z * (S(2) * zz - S(3) * (xx + yy));
  basis[13] = S(-kSh3c) * x * ring;
  basis[14] = S(kSh3e) * z * (xx - yy);
  basis[15] = S(-kSh3a) * x * (xx - S(3) * yy);
}

/// Adjoint: g = dL/dbasis, adds dL/d(direction) to grad_d[3]. Each line is the derivative of the
/// polynomial above as written, without using |d| = 1.
template <class S>
JADE_HD void sh_basis_adjoint(int degree, const S* d, const S* g, S* grad_d) {
  if (degree < 1) return;
  const S x = d[0], y = d[1], z = d[2];
  S gx = S(-kSh1) * g[3];
  S gy = S(-kSh1) * g[1];
  S gz = S(kSh1) * g[2];
  if (degree >= 2) {
    const S xy = S(kSh2a) * g[4], yz = S(-kSh2a) * g[5], xz = S(-kSh2a) * g[7];
    const S axial = S(2) * S(kSh2b) * g[6], planar = S(2) * S(kSh2c) * g[8];
    gx = gx + xy * y + xz * z + (planar - axial) * x;
    gy = gy + xy * x + yz * z - (planar + axial) * y;
    gz = gz + yz * y + xz * x + S(2) * axial * z;
  }
  if (degree >= 3) {
    const S xx = x * x, yy = y * y, zz = z * z;
    const S ring = S(4) * zz - xx - yy;
    const S g9 = S(-kSh3a) * g[9], g10 = S(kSh3b) * g[10], g11 = S(-kSh3c) * g[11];
    const S g12 = S(kSh3d) * g[12], g13 = S(-kSh3c) * g[13], g14 = S(kSh3e) * g[14];
    const S g15 = S(-kSh3a) * g[15];
    const S two(2), three(3), six(6), eight(8);
    gx = gx + g9 * six * x * y + g10 * y * z - g11 * two * x * y - g12 * six * x * z +
         g13 * (ring - two * xx) + g14 * two * x * z + g15 * three * (xx - yy);
    gy = gy + g9 * three * (xx - yy) + g10 * x * z + g11 * (ring - two * yy) - g12 * six * y * z -
         g13 * two * x * y - g14 * two * y * z - g15 * six * x * y;
    gz = gz + g10 * x * y + g11 * eight * y * z + g12 * three * (two * zz - xx - yy) +
         g13 * eight * x * z + g14 * (xx - yy);
  }
  grad_d[0] = grad_d[0] + gx;
  grad_d[1] = grad_d[1] + gy;
  grad_d[2] = grad_d[2] + gz;
}

/// Unit direction from the camera to the mean. At the camera's centre it is 0 (such a Gaussian is
/// behind the near plane anyway).
template <class S>
JADE_HD S view_direction(const S* mean, const Camera<S>& camera, S* direction) {
  for (int i = 0; i < 3; ++i) direction[i] = mean[i] - camera.center[i];
  const S norm2 =
      direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2];
  const S inverse_norm = select(norm2 > S(0), S(1) / sqrt(norm2), S(0));
  for (int i = 0; i < 3; ++i) direction[i] = direction[i] * inverse_norm;
  return inverse_norm;
}

/// Adjoint of view_direction(): g = dL/d(direction); d(n)/dv = (I − n nᵀ)/|v|. The centre is
/// −Wᵀ t, so with h = dL/dcentre: dL/dt = −W h and dL/dW = −t hᵀ.
template <class S>
JADE_HD void view_direction_adjoint(const S* direction, S inverse_norm, const S* g,
                                    const Camera<S>& camera, S* grad_mean,
                                    CameraGradient<S>* grad_camera) {
  const S along = direction[0] * g[0] + direction[1] * g[1] + direction[2] * g[2];
  S h[3];
  for (int i = 0; i < 3; ++i) {
    const S on_mean = (g[i] - direction[i] * along) * inverse_norm;
    grad_mean[i] = grad_mean[i] + on_mean;
    h[i] = -on_mean;
  }
  for (int i = 0; i < 3; ++i) {
    const S* const row = camera.rotation + 3 * i;
    grad_camera->translation[i] =
        grad_camera->translation[i] - (row[0] * h[0] + row[1] * h[1] + row[2] * h[2]);
    for (int j = 0; j < 3; ++j) {
      grad_camera->rotation[3 * i + j] =
          grad_camera->rotation[3 * i + j] - camera.translation[i] * h[j];
    }
  }
}

/// colour = max(0, Σ basis_k sh_k + ½), with sh as [K,3] in memory; works on K = sh_count(degree).
template <class S>
JADE_HD void sh_color(int degree, const S* basis, const S* sh, S* color) {
  if (degree == kPlainColor) {
    for (int c = 0; c < 3; ++c) color[c] = sh[c];
    return;
  }
  S sum[3] = {S(0.5), S(0.5), S(0.5)};
  const int count = sh_count(degree);
  for (int k = 0; k < count; ++k) {
    for (int c = 0; c < 3; ++c) sum[c] = sum[c] + basis[k] * sh[3 * k + c];
  }
  for (int c = 0; c < 3; ++c) color[c] = max(sum[c], S(0));
}

/// Adjoint of sh_color() before the clamp: g = dL/d(sum), writes grad_basis[K].
template <class S>
JADE_HD void sh_basis_gradient(int degree, const S* sh, const S* g, S* grad_basis) {
  const int count = sh_count(degree);
  for (int k = 0; k < count; ++k) {
    S sum(0);
    for (int c = 0; c < 3; ++c) sum = sum + g[c] * sh[3 * k + c];
    grad_basis[k] = sum;
  }
}

/// The remaining terms: adds to the gradients [end − begin, 3] of coefficients begin … end − 1.
template <class S>
JADE_HD void add_sh_gradient(int begin, int end, const S* basis, const S* g, S* grad_sh) {
  for (int k = begin; k < end; ++k) {
    for (int c = 0; c < 3; ++c) {
      S& grad = grad_sh[3 * (k - begin) + c];
      grad = grad + basis[k] * g[c];
    }
  }
}

/// Adjoint of the clamp: a channel clamped at 0 (color == 0) has no gradient.
template <class S>
JADE_HD void clamp_adjoint(int degree, const S* color, const S* grad_color, S* g) {
  for (int c = 0; c < 3; ++c) {
    g[c] = degree == kPlainColor ? grad_color[c] : select(color[c] > S(0), grad_color[c], S(0));
  }
}

/// True unless one of the values is infinite or NaN.
template <class S>
JADE_HD auto all_finite(const S* values, int count) {
  const S zero(0);
  S poison(0);  // stays 0 unless a value is not finite
  for (int k = 0; k < count; ++k) poison = poison + values[k] * zero;
  return within(poison, zero);
}

/// A Gaussian's colour seen from a camera.
template <class S>
JADE_HD void view_color(int degree, const S* mean, const Camera<S>& camera, const S* sh, S* color) {
  S direction[3], basis[16];
  view_direction(mean, camera, direction);
  sh_basis(degree, direction, basis);
  sh_color(degree, basis, sh, color);
}

}  // namespace JADE_ISA
}  // namespace jade::splat::math
