// SPDX-License-Identifier: Apache-2.0
// SSIM of a band of rows, row by row: horizontally filtered rows are stored in ring buffers of 11
// rows, so that all intermediate values stay in the cache. Plain loops over columns. Compiled once
// per instruction set by jade_add_isa_sources().
#pragma once

#include "jade/imaging/ssim_band.h"

namespace jade::imaging {
namespace JADE_ISA {

constexpr int64_t kPad = 2 * kSsimRadius;

template <class T>
JADE_HD void filter_row(const T* __restrict padded, const T* __restrict w, T* __restrict out,
                        int64_t n) {
  for (int64_t x = 0; x < n; ++x) {
    T sum = w[5] * padded[x + 5];
    sum += w[0] * (padded[x] + padded[x + 10]);
    sum += w[1] * (padded[x + 1] + padded[x + 9]);
    sum += w[2] * (padded[x + 2] + padded[x + 8]);
    sum += w[3] * (padded[x + 3] + padded[x + 7]);
    sum += w[4] * (padded[x + 4] + padded[x + 6]);
    out[x] = sum;
  }
}

/// Filters vertically the 11 rows around `centre` in a ring of rows of n values.
template <class T>
JADE_HD void filter_ring(const T* ring, int64_t centre, const T* __restrict w, T* __restrict out,
                         int64_t n) {
  const T* r[kSsimTaps];
  for (int k = 0; k < kSsimTaps; ++k)
    r[k] = ring + ((centre + k - kSsimRadius + 2 * kSsimTaps) % kSsimTaps) * n;
  const T *r0 = r[0], *r1 = r[1], *r2 = r[2], *r3 = r[3], *r4 = r[4], *r5 = r[5], *r6 = r[6],
          *r7 = r[7], *r8 = r[8], *r9 = r[9], *r10 = r[10];
  for (int64_t x = 0; x < n; ++x) {
    T sum = w[5] * r5[x];
    sum += w[0] * (r0[x] + r10[x]);
    sum += w[1] * (r1[x] + r9[x]);
    sum += w[2] * (r2[x] + r8[x]);
    sum += w[3] * (r3[x] + r7[x]);
    sum += w[4] * (r4[x] + r6[x]);
    out[x] = sum;
  }
}

/// Always eight partial sums, so that the result does not depend on the vector width.
template <class T>
JADE_HD double sum_row(const T* __restrict row, int64_t n) {
  double lanes[8] = {};
  int64_t x = 0;
  for (; x + 8 <= n; x += 8) {
    for (int k = 0; k < 8; ++k) lanes[k] += double(row[x + k]);
  }
  for (; x < n; ++x) lanes[0] += double(row[x]);
  return ((lanes[0] + lanes[1]) + (lanes[2] + lanes[3])) +
         ((lanes[4] + lanes[5]) + (lanes[6] + lanes[7]));
}

template <class T>
struct Buffers {
  T* rings[kMoments];   ///< 11 rows each
  T* maps[kMaps];       ///< 11 rows each
  T* rows[kMoments];    ///< one filtered row each
  T* padded[kMoments];  ///< one row with 5 zeros on either side
  T* similarity;

  JADE_HD Buffers(T* scratch, int64_t n) {
    for (T*& ring : rings) take(ring, scratch, kSsimTaps * n);
    for (T*& map : maps) take(map, scratch, kSsimTaps * n);
    for (T*& row : rows) take(row, scratch, n);
    take(similarity, scratch, n);
    for (T*& row : padded) {
      take(row, scratch, n + kPad);
      for (int64_t x = 0; x < n + kPad; ++x) row[x] = 0;
    }
  }
  static JADE_HD void take(T*& out, T*& scratch, int64_t count) {
    out = scratch;
    scratch += count;
  }
};

template <class T>
JADE_HD void zero_row(T* row, int64_t n) {
  for (int64_t x = 0; x < n; ++x) row[x] = 0;
}

/// Filters input row i horizontally into the rings; rows outside the image are zero.
template <class T>
JADE_HD void push_input(const SsimBand<T>& in, Buffers<T>& buffers, const T* w, int64_t i,
                        bool a_too, bool b_too) {
  const int64_t n = in.width, slot = (i + 2 * kSsimTaps) % kSsimTaps * n;
  const bool inside = i >= 0 && i < in.height;
  const T* __restrict b = in.b + (inside ? i * n : 0);
  T* __restrict pb = buffers.padded[3] + kSsimRadius;
  T* __restrict pbb = buffers.padded[4] + kSsimRadius;
  if (!inside) {
    for (int q = a_too ? 0 : 3; q < (b_too ? kMoments : 3); ++q)
      zero_row(buffers.rings[q] + slot, n);
    return;
  }
  if (a_too) {
    const T* __restrict a = in.a + i * n;
    T* __restrict pa = buffers.padded[0] + kSsimRadius;
    T* __restrict paa = buffers.padded[1] + kSsimRadius;
    T* __restrict pab = buffers.padded[2] + kSsimRadius;
    for (int64_t x = 0; x < n; ++x) {
      pa[x] = a[x];
      paa[x] = a[x] * a[x];
      pab[x] = a[x] * b[x];
    }
  }
  if (b_too) {
    for (int64_t x = 0; x < n; ++x) {
      pb[x] = b[x];
      pbb[x] = b[x] * b[x];
    }
  }
  for (int q = a_too ? 0 : 3; q < (b_too ? kMoments : 3); ++q) {
    filter_row(buffers.padded[q], w, buffers.rings[q] + slot, n);
  }
}

/// Similarity of row r from the rings, its sum, and the derivative maps filtered horizontally.
template <class T>
JADE_HD void push_map(const SsimBand<T>& in, Buffers<T>& buffers, const T* w, int64_t r, int maps) {
  const int64_t n = in.width, slot = (r + 2 * kSsimTaps) % kSsimTaps * n;
  if (r < 0 || r >= in.height) {
    for (int q = 0; q < maps; ++q) zero_row(buffers.maps[q] + slot, n);
    return;
  }
  const bool fixed = in.mean_b != nullptr;
  for (int q = 0; q < (fixed ? 3 : kMoments); ++q)
    filter_ring(buffers.rings[q], r, w, buffers.rows[q], n);
  const T* __restrict ma = buffers.rows[0];
  const T* __restrict eaa = buffers.rows[1];
  const T* __restrict eab = buffers.rows[2];
  const T* __restrict mb = fixed ? in.mean_b + r * n : buffers.rows[3];
  const T* __restrict ebb = fixed ? in.square_b + r * n : buffers.rows[4];
  T* __restrict s = buffers.similarity;
  T* __restrict d_ma = buffers.padded[0] + kSsimRadius;
  T* __restrict d_sq = buffers.padded[1] + kSsimRadius;
  T* __restrict d_ab = buffers.padded[2] + kSsimRadius;
  T* __restrict d_mb = buffers.padded[3] + kSsimRadius;
  for (int64_t x = 0; x < n; ++x) {
    const SsimMoments<T> moments = {ma[x], eaa[x], eab[x], mb[x], ebb[x]};
    const SsimTerms<T> terms = ssim_terms(moments);
    const SsimDerivatives<T> d = ssim_derivatives(moments, terms);
    s[x] = terms.value;
    d_ma[x] = d.a;
    d_mb[x] = d.b;
    d_sq[x] = d.square;
    d_ab[x] = d.ab;
  }
  if (r >= in.row_begin && r < in.row_end) in.ssim_sums[r] = sum_row(s, n);
  for (int q = 0; q < maps; ++q) filter_row(buffers.padded[q], w, buffers.maps[q] + slot, n);
}

/// Gradient of row y, and the sum of |a − b| in it.
template <class T>
JADE_HD void pull_gradient(const SsimBand<T>& in, Buffers<T>& buffers, const T* w, int64_t y,
                           int maps) {
  const int64_t n = in.width;
  const T* __restrict a = in.a + y * n;
  const T* __restrict b = in.b + y * n;
  for (int q = 0; q < maps; ++q) filter_ring(buffers.maps[q], y, w, buffers.rows[q], n);
  const T* __restrict d_sq = buffers.rows[1];
  const T* __restrict d_ab = buffers.rows[2];
  const T ws = in.weight_ssim, wl = in.weight_l1;
  if (in.grad_a != nullptr) {
    const T* __restrict d_ma = buffers.rows[0];
    T* __restrict out = in.grad_a + y * n;
    for (int64_t x = 0; x < n; ++x) {
      const T sign = l1_gradient(a[x], b[x]);
      out[x] = ws * ssim_gradient(d_ma[x], d_sq[x], d_ab[x], a[x], b[x]) + wl * sign;
    }
  }
  if (in.grad_b != nullptr) {
    const T* __restrict d_mb = buffers.rows[3];
    T* __restrict out = in.grad_b + y * n;
    for (int64_t x = 0; x < n; ++x) {
      const T sign = l1_gradient(a[x], b[x]);
      out[x] = ws * ssim_gradient(d_mb[x], d_sq[x], d_ab[x], b[x], a[x]) - wl * sign;
    }
  }
}

template <class T>
JADE_HD void l1_row(const SsimBand<T>& in, Buffers<T>& buffers, int64_t y) {
  const int64_t n = in.width;
  const T* __restrict a = in.a + y * n;
  const T* __restrict b = in.b + y * n;
  T* __restrict out = buffers.similarity;
  for (int64_t x = 0; x < n; ++x) out[x] = a[x] > b[x] ? a[x] - b[x] : b[x] - a[x];
  in.l1_sums[y] = sum_row(out, n);
}

template <class T>
void band_body(const SsimBand<T>& in, const double* window) {
  T w[kSsimTaps];
  for (int k = 0; k < kSsimTaps; ++k) w[k] = T(window[k]);
  Buffers<T> buffers(in.scratch, in.width);
  const bool gradient = in.grad_a != nullptr || in.grad_b != nullptr;
  const int maps = !gradient ? 0 : in.grad_b != nullptr ? 4 : 3;
  const int64_t reach = gradient ? kSsimRadius : 0;
  for (int64_t i = in.row_begin - reach - kSsimRadius; i < in.row_end + reach + kSsimRadius; ++i) {
    push_input(in, buffers, w, i, true, in.mean_b == nullptr);
    const int64_t r = i - kSsimRadius;
    if (r < in.row_begin - reach) continue;
    push_map(in, buffers, w, r, maps);
    const int64_t y = r - reach;
    if (y < in.row_begin) continue;
    if (gradient) pull_gradient(in, buffers, w, y, maps);
    if (in.l1_sums != nullptr) l1_row(in, buffers, y);
  }
}

template <class T>
void moments_body(const SsimBand<T>& in, const double* window, T* mean_out, T* square_out) {
  T w[kSsimTaps];
  for (int k = 0; k < kSsimTaps; ++k) w[k] = T(window[k]);
  Buffers<T> buffers(in.scratch, in.width);
  for (int64_t i = in.row_begin - kSsimRadius; i < in.row_end + kSsimRadius; ++i) {
    push_input(in, buffers, w, i, false, true);
    const int64_t r = i - kSsimRadius;
    if (r < in.row_begin) continue;
    filter_ring(buffers.rings[3], r, w, mean_out + r * in.width, in.width);
    filter_ring(buffers.rings[4], r, w, square_out + r * in.width, in.width);
  }
}

const SsimKernelSet kSsimKernels = {{band_body<float>, moments_body<float>},
                                    {band_body<double>, moments_body<double>}};

}  // namespace JADE_ISA
}  // namespace jade::imaging
