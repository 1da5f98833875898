// SPDX-License-Identifier: Apache-2.0
// L_ev at one pixel and its gradient, shared by CPU and CUDA. Private to this folder.
#pragma once

#include <cstdint>

#include "jade/imaging/luma.h"
#include "jade/kernel/host_device.h"

namespace jade::losses {

constexpr double kLinLogKnee = 20, kLogOfKnee = 2.995732273553991;

/// ℓ(x) of x in [0,255]: x ln(20)/20 up to 20, ln x above.
JADE_HD double lin_log(double x) {
  return x <= kLinLogKnee ? x * (kLogOfKnee / kLinLogKnee) : kernel::log(x);
}
/// dℓ/dx
JADE_HD double lin_log_slope(double x) {
  return x <= kLinLogKnee ? kLogOfKnee / kLinLogKnee : 1 / x;
}

/// Weight of R, G and B with EventPair::weighted_colors.
JADE_HD double color_weight(int64_t c) { return c == 1 ? 0.2 : 0.4; }

/// EventPair as plain pointers.
template <class T>
struct EventPixels {
  const T* before;  ///< [3,H,W]
  const T* after;
  const T* counts;         ///< [H,W]
  const int64_t* indices;  ///< [P]
  const bool* filter;      ///< [H,W,3]; null: gray
  int64_t plane;           ///< H · W
  int64_t count;           ///< P
  double threshold_positive, threshold_negative;
  bool weighted_colors;
};

/// A pixel's share of L_ev's numerator and denominator.
struct EventTerm {
  double value;     ///< w (Δℓ/Θ − n)², 0 if n is 0
  double residual;  ///< its derivative by Δℓ
  double weight;    ///< w
};

/// 255 · luma, or 255 · a channel. In double from here on, because differences of logarithms lose
/// digits.
template <class T>
JADE_HD double gray_level(const EventPixels<T>& in, const T* image, int64_t pixel) {
  return 255 *
         double(imaging::luma(image[pixel], image[in.plane + pixel], image[2 * in.plane + pixel]));
}
template <class T>
JADE_HD double channel_level(const EventPixels<T>& in, const T* image, int64_t c, int64_t pixel) {
  return 255 * double(image[c * in.plane + pixel]);
}

template <class T>
JADE_HD EventTerm event_term(const EventPixels<T>& in, int64_t pixel) {
  const double n = double(in.counts[pixel]);
  double change = 0, weight = 0;
  if (in.filter == nullptr) {
    change = lin_log(gray_level(in, in.after, pixel)) - lin_log(gray_level(in, in.before, pixel));
    weight = 1;
  } else {
    for (int64_t c = 0; c < 3; ++c) {
      if (!in.filter[3 * pixel + c]) continue;
      change += lin_log(channel_level(in, in.after, c, pixel)) -
                lin_log(channel_level(in, in.before, c, pixel));
      weight += in.weighted_colors ? color_weight(c) : 1.0;
    }
  }
  if (n == 0) return {0, 0, weight};
  const double threshold = n > 0 ? in.threshold_positive : in.threshold_negative;
  const double off = change / threshold - n;
  return {weight * off * off, 2 * weight * off / threshold, weight};
}

/// Calls add(index of the render, channel, gradient) for each value that the pixel read, from the
/// gradient of Δℓ.
template <class T, class Add>
JADE_HD void event_term_adjoint(const EventPixels<T>& in, int64_t pixel, double of_change,
                                const Add& add) {
  for (int64_t side = 0; side < 2; ++side) {
    const T* const image = side == 0 ? in.before : in.after;
    const double of_log = side == 0 ? -of_change : of_change;
    for (int64_t c = 0; c < 3; ++c) {
      if (in.filter == nullptr) {
        const double of_luma = 255 * of_log * lin_log_slope(gray_level(in, image, pixel));
        add(side, c, T(imaging::luma_gradient(c, of_luma)));
      } else if (in.filter[3 * pixel + c]) {
        add(side, c, T(255 * of_log * lin_log_slope(channel_level(in, image, c, pixel))));
      }
    }
  }
}

}  // namespace jade::losses
