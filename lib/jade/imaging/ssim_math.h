// SPDX-License-Identifier: Apache-2.0
// SSIM at one pixel, and its gradient.
#pragma once

#include "jade/kernel/host_device.h"

namespace jade::imaging {

constexpr int kSsimRadius = 5;
constexpr int kSsimTaps = 2 * kSsimRadius + 1;
constexpr double kSsimC1 = 1e-4, kSsimC2 = 9e-4;

// With window means μ and E, and
//   A1 = 2 μa μb + C1, A2 = 2 (E[ab] − μa μb) + C2, B1 = μa² + μb² + C1,
//   B2 = E[a²] − μa² + E[b²] − μb² + C2,            S = A1 A2 / (B1 B2),
// the derivatives of S are ∂E[ab] = 2 A1 / (B1 B2), ∂E[a²] = ∂E[b²] = −S / B2 and
//   ∂μa = 2 μb (A2 − A1) / (B1 B2) − 2 μa S (1/B1 − 1/B2).
// The window is symmetric, so Σ S has the gradient G∗∂μa + 2 a G∗∂E[a²] + b G∗∂E[ab].

/// Window means at a pixel.
template <class T>
struct SsimMoments {
  T a, aa, ab, b, bb;
};

template <class T>
struct SsimTerms {
  T a1, a2, b1, b2;
  T inverse;  ///< 1 / (B1 B2)
  T value;    ///< S
};

template <class T>
JADE_HD SsimTerms<T> ssim_terms(const SsimMoments<T>& m) {
  const T mm = m.a * m.b, aa = m.a * m.a, bb = m.b * m.b;
  const T a1 = 2 * mm + T(kSsimC1), a2 = 2 * (m.ab - mm) + T(kSsimC2);
  const T b1 = aa + bb + T(kSsimC1), b2 = (m.aa - aa) + (m.bb - bb) + T(kSsimC2);
  const T inverse = 1 / (b1 * b2);
  return {a1, a2, b1, b2, inverse, a1 * a2 * inverse};
}

/// Derivatives of S by the moments; the derivative by E[b²] equals that by E[a²].
template <class T>
struct SsimDerivatives {
  T a, square, ab, b;
};

template <class T>
JADE_HD SsimDerivatives<T> ssim_derivatives(const SsimMoments<T>& m, const SsimTerms<T>& t) {
  const T cross = 2 * (t.a2 - t.a1) * t.inverse, own = 2 * t.value * (t.b2 - t.b1) * t.inverse;
  return {cross * m.b - own * m.a, -t.value * t.b1 * t.inverse, 2 * t.a1 * t.inverse,
          cross * m.a - own * m.b};
}

/// The gradient of Σ S at a pixel, x in one image and `other` in the other, from the filtered
/// derivatives.
template <class T>
JADE_HD T ssim_gradient(T d_mean, T d_square, T d_product, T x, T other) {
  return d_mean + 2 * x * d_square + other * d_product;
}

/// The derivative of |a − b| by a, 0 if they are equal.
template <class T>
JADE_HD T l1_gradient(T a, T b) {
  return T(a > b) - T(a < b);
}

}  // namespace jade::imaging
