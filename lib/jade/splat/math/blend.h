// SPDX-License-Identifier: Apache-2.0
// Blending of one splat into one pixel, and its adjoint, shared by the CPU's packs and CUDA.
#pragma once

#include "jade/splat/math/scalar.h"

namespace jade::splat::math {
inline namespace JADE_ISA {

constexpr double kMaxAlpha = 0.99;  ///< of a splat at a pixel, unless a call overrides it
constexpr double kLog2MinAlpha = -7.994353436858858;  ///< log2(1/255)
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

/// Moments over pixels of u = dL/d ln(α before clamping), with dx, dy from the splat to the pixel.
template <class S>
struct Moments {
  S u, x, y, xx, xy, yy;
};

/// Result of the adjoint of blending per splat: sums over pixels, which both backends store in this
/// order: Moments, dL/dcolour, then dL/ddepth if depth is rendered.
constexpr int kPixelSums = 9;

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

/// A splat's exponent along a row of pixels: a dx² + b dx + c.
template <class S>
struct RowFalloff {
  S a, b, c;
};

template <class S>
JADE_HD RowFalloff<S> at_row(const Falloff<S>& f, S log2_opacity, S dy) {
  return {f.a, f.b * dy, fma(f.c * dy, dy, log2_opacity)};
}

/// log2 of α before clamping. The same expression in the forward and the backward pass, so that
/// both make the same decisions.
template <class S>
JADE_HD S exponent(const RowFalloff<S>& row, S dx) {
  return fma(fma(row.a, dx, row.b), dx, row.c);
}

/// The exponent as a polynomial about a point, for pixels at offsets (x, y) from it:
/// value + slope_x x + slope_y y + a x² + b x y + c y². CUDA computes it once per block of pixels.
template <class S>
struct LocalFalloff {
  Falloff<S> falloff;
  S value, slope_x, slope_y;
};

/// @param dx, dy  from the splat to the point
template <class S>
JADE_HD LocalFalloff<S> about(const Falloff<S>& f, S log2_opacity, S dx, S dy) {
  return {f, exponent(at_row(f, log2_opacity, dy), dx), fma(S(2) * f.a, dx, f.b * dy),
          fma(S(2) * f.c, dy, f.b * dx)};
}

/// For exponent() at offsets x along the row at offset y.
template <class S>
JADE_HD RowFalloff<S> at_row(const LocalFalloff<S>& f, S y) {
  return {f.falloff.a, fma(f.falloff.b, y, f.slope_x),
          fma(fma(f.falloff.c, y, f.slope_y), y, f.value)};
}

/// Upper bound of float exponents from about(dx, dy) at offsets up to 4 px: log2_opacity, and an
/// allowance for rounding. Terms that cancel reach about 4 |a dx² + c dy²| + 250, since a dilated
/// splat has |a|, |c| < 2.5, and each of their some ten roundings errs by 2^-24. The test finds
/// errors of 2^-22 of this sum.
template <class S>
JADE_HD S exponent_bound(const Falloff<S>& f, S log2_opacity, S dx, S dy) {
  return log2_opacity - S(0x1p-18) * (f.a * dx * dx + f.c * dy * dy) + S(0x1p-10);
}

/// True if the splat's α reaches 1/255.
template <class S>
JADE_HD auto is_visible(S exponent_value) {
  return exponent_value >= S(kLog2MinAlpha);
}

/// For gradient tests: fades in from 1/255 to 2/255 by a cubic with zero slope at both ends.
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

/// Arithmetic that backends may replace. This one: as written. `product` must not be fused with the
/// following subtraction, so that both passes round T identically.
struct PlainArithmetic {
  template <class Mask, class S>
  JADE_HD static S exp2_where(Mask mask, S x) {
    return keep(mask, exp2(x));
  }
  template <class S>
  JADE_HD static S cap(S alpha, S max_alpha) {
    return min(alpha, max_alpha);
  }
  template <class S>
  JADE_HD static S product(S a, S b) {
    return a * b;
  }
  template <class S>
  JADE_HD static S ratio(S a, S b) {
    return a / b;
  }
};

/// Contribution of one splat to one pixel.
template <class S>
struct BlendStep {
  S raw_alpha;                    ///< before the fade and the cap
  S alpha;                        ///< 0 if the splat is not visible or the pixel has stopped
  S used;                         ///< α T
  S weight;                       ///< the weight of its colour: α T, or 0 as alpha
  decltype(S(0) > S(0)) goes_on;  ///< false: no splat changes the pixel from this one on
};

/// Updates a pixel's transmittance by a splat: T(1 − α), or, if that is too small, stops the pixel
/// before the splat by making T negative. kSmooth, for gradient tests: α fades in, nothing stops.
/// kCapped: false for splats whose α cannot exceed max_alpha anywhere.
template <class Arithmetic, bool kSmooth, bool kCapped = true, class S>
JADE_HD BlendStep<S> blend_step(S exponent_value, S max_alpha, S* transmittance) {
  const S t = *transmittance;
  BlendStep<S> step;
  step.raw_alpha = Arithmetic::exp2_where(is_visible(exponent_value), exponent_value);
  const S faded = kSmooth ? step.raw_alpha * fade(step.raw_alpha) : step.raw_alpha;
  const S alpha = kCapped ? Arithmetic::cap(faded, max_alpha) : faded;
  step.used = Arithmetic::product(alpha, t);
  const S left = t - step.used;
  step.goes_on = left > S(kSmooth ? -1 : kMinTransmittance);
  step.alpha = keep(step.goes_on, alpha);
  step.weight = keep(step.goes_on, step.used);
  *transmittance = select(step.goes_on, left, make_negative(t));
  return step;
}

/// For replay_step(): a pixel goes on while its T is above this. A splat that changes a pixel takes
/// at least 1/255 of T, and alpha = 1 − T_end is rounded to 2^-25, 3e-4 of the least T_end.
/// @param alpha  of the image
template <class S>
JADE_HD S replay_bound(S alpha) {
  return S(1.002) * (S(1) - alpha);
}

/// blend_step() without kSmooth in a backward pass that knows T_end. T is the same while the pixel
/// goes on, and stays T_end afterwards, so this needs one choice instead of four. max_alpha must be
/// at least 1/255.
template <class Arithmetic, bool kCapped, class S>
JADE_HD BlendStep<S> replay_step(S exponent_value, S max_alpha, S bound, S* transmittance) {
  const S t = *transmittance;
  BlendStep<S> step;
  step.goes_on = t > bound;
  step.raw_alpha =
      Arithmetic::exp2_where(is_visible(exponent_value) & step.goes_on, exponent_value);
  step.alpha = kCapped ? Arithmetic::cap(step.raw_alpha, max_alpha) : step.raw_alpha;
  step.used = step.weight = Arithmetic::product(step.alpha, t);
  *transmittance = t - step.used;
  return step;
}

/// Adjoint of both: returns u_i = dL/d ln α_i before clamping, for v_i = ⟨dL/dC, c_i⟩.
///     C = Σ c_i α_i T_i + T_end · background,  T_{i+1} = T_i (1 − α_i),  so with
///     B_i = Σ_{j>i} v_j α_j T_j + T_end ⟨dL/dC, background⟩, in which each term has a 1 − α_i:
///     dL/dα_i = T_i v_i − B_i / (1 − α_i),  and with B_{i-1} = B_i + α_i T_i v_i
///     u_i = α_i dL/dα_i = B_{i-1} − B_i / (1 − α_i).
///     Front to back, *behind starts as B_{-1} = ⟨dL/dC, C⟩. Clamped and stopped values are
///     constant: both give 0. dL/dc_i = weight · dL/dC.
template <class Arithmetic, bool kSmooth, bool kCapped = true, class S>
JADE_HD S blend_step_adjoint(const BlendStep<S>& step, S value, S max_alpha, S* behind) {
  const S before = *behind;
  *behind = fma(-step.weight, value, before);
  S u = fma(-*behind, Arithmetic::ratio(S(1), S(1) - step.alpha), before);
  if constexpr (kSmooth) u = u * fade_adjoint(step.raw_alpha);
  if constexpr (kCapped) return keep(step.alpha < max_alpha, u);
  return u;
}

}  // namespace JADE_ISA
}  // namespace jade::splat::math
