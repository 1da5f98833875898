// SPDX-License-Identifier: Apache-2.0
// One splat on one pixel, and back.
#pragma once

#include "jade/splat/math/scalar.h"

namespace jade::splat::math {
inline namespace JADE_ISA {

constexpr double kMaxAlpha = 0.99;
constexpr double kMinAlpha = 1.0 / 255.0;
constexpr double kLog2MinAlpha = -7.994353436858858;
constexpr double kMinTransmittance = 1e-4;
constexpr double kLog2E = 1.4426950408889634;

/// The exponent's coefficients: α = 2^(a dx² + b dx dy + c dy² + log2 o), from the inverse of the
/// dilated covariance scaled by −½ log2 e.
template <class S>
struct Falloff {
  S a, b, c;
};

template <class S>
JADE_HD Falloff<S> make_falloff(S cov_xx, S cov_xy, S cov_yy, S det) {
  const S scale = S(-0.5 * kLog2E) / det;
  return {scale * cov_yy, S(-2) * scale * cov_xy, scale * cov_xx};
}

/// Moments over pixels of u = dL/d ln(α before the cap), with dx, dy from the splat to the pixel.
template <class S>
struct Moments {
  S u, x, y, xx, xy, yy;
};

/// Adjoint of the falloff and of the mean, in one: with conic [A B; B C] = Σ2d⁻¹ and q = dᵀ Σ2d⁻¹
/// d, dL/dmean = Σ2d⁻¹ Σ u d and dL/dΣ2d = ½ Σ2d⁻¹ (Σ u d dᵀ) Σ2d⁻¹. cov_xy's gradient counts both
/// off-diagonal entries.
template <class S>
JADE_HD void falloff_adjoint(const Falloff<S>& f, const Moments<S>& m, S* grad_x, S* grad_y,
                             S* grad_xx, S* grad_xy, S* grad_yy) {
  const S unscale(-2.0 / kLog2E);
  const S conic_a = unscale * f.a, conic_b = unscale * S(0.5) * f.b, conic_c = unscale * f.c;
  *grad_x = conic_a * m.x + conic_b * m.y;
  *grad_y = conic_b * m.x + conic_c * m.y;
  const S p = conic_a * m.xx + conic_b * m.xy, q = conic_a * m.xy + conic_b * m.yy;
  const S r = conic_b * m.xx + conic_c * m.xy, s = conic_b * m.xy + conic_c * m.yy;
  *grad_xx = S(0.5) * (p * conic_a + q * conic_b);
  *grad_xy = p * conic_b + q * conic_c;
  *grad_yy = S(0.5) * (r * conic_b + s * conic_c);
}

/// log2 of the α before the cap. The same expression in the forward and the backward pass, so
/// that both take the same decisions.
template <class S>
JADE_HD S exponent(const Falloff<S>& f, S log2_opacity, S dx, S dy) {
  return fma(fma(f.a, dx, f.b * dy), dx, fma(f.c * dy, dy, log2_opacity));
}

/// True where the splat counts at all.
template <class S>
JADE_HD auto is_visible(S exponent_value) {
  return exponent_value >= S(kLog2MinAlpha);
}

/// For gradient tests: fades in from 1/255 to 2/255 by a cubic with flat ends.
template <class S>
JADE_HD S fade(S raw_alpha) {
  const S t = min(max(raw_alpha * S(255) - S(1), S(0)), S(1));
  return t * t * (S(3) - S(2) * t);
}
/// d ln(α fade(α)) / d ln α
template <class S>
JADE_HD S fade_adjoint(S raw_alpha) {
  const S t = min(max(raw_alpha * S(255) - S(1), S(0)), S(1));
  return select(t > S(0), S(1) + S(6) * (S(1) - t) * raw_alpha * S(255) / (t * (S(3) - S(2) * t)),
                S(0));
}

/// Adjoint of blending. C = Σ v_i α_i T_i + v_end T_end with T_{i+1} = T_i (1 − α_i) and v_i the
/// splat's colour dotted with dL/dC. With `behind` = everything after i, background included:
///     dL/dα_i = T_i v_i − behind / (1 − α_i), here times α_i: the gradient to ln α_i.
/// Front to back, `behind` starts as ⟨dL/dC, C⟩ and loses α_i T_i v_i at each splat.
template <class S>
JADE_HD S blend_adjoint(S alpha, S weight_value, S behind) {
  return weight_value - behind * (alpha / (S(1) - alpha));
}

}  // namespace JADE_ISA
}  // namespace jade::splat::math
