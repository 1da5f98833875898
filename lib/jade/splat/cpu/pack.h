// SPDX-License-Identifier: Apache-2.0
// N numbers in a vector register: the scalar type S of math/ for the CPU kernels. Written with the
// compilers' vector extensions, so one source serves every instruction set; intrinsics only where
// those are insufficient (fused multiply-add, mask to bits).
#pragma once

#include <cstdint>
#include <cstring>
#include <type_traits>

#if defined(__GNUC__) && !defined(__clang__)
// GCC's own 512-bit functions begin with an intentionally undefined value.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#if defined(__AVX2__)
#include <immintrin.h>
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

#include "jade/splat/math/scalar.h"

// Return the first expression for eight floats, the second for four doubles (AVX-512: twice that).
#if defined(__AVX2__) && defined(__FMA__)
#define JADE_WITH_AVX(floats, doubles)                   \
  if constexpr (sizeof(T) == 4 && N == 8) return floats; \
  if constexpr (sizeof(T) == 8 && N == 4) return doubles;
#else
#define JADE_WITH_AVX(floats, doubles)
#endif
#if defined(__AVX512F__) && defined(__AVX512DQ__)
#define JADE_WITH_AVX512(floats, doubles)                 \
  if constexpr (sizeof(T) == 4 && N == 16) return floats; \
  if constexpr (sizeof(T) == 8 && N == 8) return doubles;
#else
#define JADE_WITH_AVX512(floats, doubles)
#endif

namespace jade::splat::math {
inline namespace JADE_ISA {

template <class T>
struct PackTraits;
template <>
struct PackTraits<float> {
  using Int = int32_t;
};
template <>
struct PackTraits<double> {
  using Int = int64_t;
};

/// The compiler's vector of N elements. (GCC loses the attribute of a typedef whose element type
/// does not depend on a template argument.)
template <class E, int N>
struct VectorOf {
  typedef E Type __attribute__((vector_size(N * sizeof(E))));
};

#if defined(__AVX512F__) && defined(__AVX512DQ__)
/// Whether a comparison of so many bytes gives one bit per lane, in a register for masks.
constexpr bool has_mask_register(int bytes) { return bytes == 64; }
#else
constexpr bool has_mask_register(int) { return false; }
#endif

/// Each lane is all ones or all zero.
template <class T, int N, bool kRegister = has_mask_register(N * sizeof(T))>
struct PackMask {
  using Int = typename PackTraits<T>::Int;
  typedef Int Vector __attribute__((vector_size(N * sizeof(T))));
  Vector v;

  JADE_HD friend PackMask operator&(PackMask a, PackMask b) { return {a.v & b.v}; }
  JADE_HD friend PackMask operator|(PackMask a, PackMask b) { return {a.v | b.v}; }
  JADE_HD friend PackMask operator~(PackMask a) { return {~a.v}; }
};

/// One bit per lane.
template <class T, int N>
struct PackMask<T, N, true> {
  using Bits = std::conditional_t<N == 16, uint16_t, uint8_t>;
  Bits v;

  JADE_HD friend PackMask operator&(PackMask a, PackMask b) { return {Bits(a.v & b.v)}; }
  JADE_HD friend PackMask operator|(PackMask a, PackMask b) { return {Bits(a.v | b.v)}; }
  JADE_HD friend PackMask operator~(PackMask a) { return {Bits(~a.v)}; }
};

template <class T, int N>
struct Pack {
  using Scalar = T;
  using Mask = PackMask<T, N>;
  using Int = typename PackTraits<T>::Int;
  typedef T Vector __attribute__((vector_size(N * sizeof(T))));
  typedef Int IntVector __attribute__((vector_size(N * sizeof(T))));
  static constexpr int kLanes = N;

  Vector v;

  Pack() = default;
  JADE_HD Pack(Vector vector) : v(vector) {}
  template <class U, class = std::enable_if_t<std::is_arithmetic<U>::value>>
  JADE_HD explicit Pack(U value) : v(static_cast<T>(value) - Vector{}) {}

  JADE_HD static Pack load(const T* p) {
    Pack r;
    std::memcpy(&r.v, p, sizeof(r.v));
    return r;
  }
  JADE_HD void store(T* p) const { std::memcpy(p, &v, sizeof(v)); }
  JADE_HD static Pack iota() {
    Pack r;
    for (int i = 0; i < N; ++i) r.v[i] = T(i);
    return r;
  }

  JADE_HD friend Pack operator+(Pack a, Pack b) { return a.v + b.v; }
  JADE_HD friend Pack operator-(Pack a, Pack b) { return a.v - b.v; }
  JADE_HD friend Pack operator*(Pack a, Pack b) { return a.v * b.v; }
  JADE_HD friend Pack operator/(Pack a, Pack b) { return a.v / b.v; }
  JADE_HD friend Pack operator-(Pack a) { return -a.v; }
  JADE_HD friend Mask operator>(Pack a, Pack b) { return b < a; }
  JADE_HD friend Mask operator>=(Pack a, Pack b) { return b <= a; }
  // GCC rewrites comparisons of vectors into blends with constants, but not the intrinsics.
  JADE_HD friend Mask operator<(Pack a, Pack b) {
    JADE_WITH_AVX((Mask{(IntVector)_mm256_cmp_ps((__m256)a.v, (__m256)b.v, _CMP_LT_OQ)}),
                  (Mask{(IntVector)_mm256_cmp_pd((__m256d)a.v, (__m256d)b.v, _CMP_LT_OQ)}))
    JADE_WITH_AVX512((Mask{_mm512_cmp_ps_mask((__m512)a.v, (__m512)b.v, _CMP_LT_OQ)}),
                     (Mask{_mm512_cmp_pd_mask((__m512d)a.v, (__m512d)b.v, _CMP_LT_OQ)}))
    if constexpr (!has_mask_register(N * sizeof(T))) return {a.v < b.v};
  }
  JADE_HD friend Mask operator<=(Pack a, Pack b) {
    JADE_WITH_AVX((Mask{(IntVector)_mm256_cmp_ps((__m256)a.v, (__m256)b.v, _CMP_LE_OQ)}),
                  (Mask{(IntVector)_mm256_cmp_pd((__m256d)a.v, (__m256d)b.v, _CMP_LE_OQ)}))
    JADE_WITH_AVX512((Mask{_mm512_cmp_ps_mask((__m512)a.v, (__m512)b.v, _CMP_LE_OQ)}),
                     (Mask{_mm512_cmp_pd_mask((__m512d)a.v, (__m512d)b.v, _CMP_LE_OQ)}))
    if constexpr (!has_mask_register(N * sizeof(T))) return {a.v <= b.v};
  }
};

template <class T, int N>
JADE_HD Pack<T, N> select(PackMask<T, N> mask, Pack<T, N> a, Pack<T, N> b) {
  using V [[maybe_unused]] = typename Pack<T, N>::Vector;
  JADE_WITH_AVX(V(_mm256_blendv_ps((__m256)b.v, (__m256)a.v, (__m256)mask.v)),
                V(_mm256_blendv_pd((__m256d)b.v, (__m256d)a.v, (__m256d)mask.v)))
  JADE_WITH_AVX512(V(_mm512_mask_blend_ps(mask.v, (__m512)b.v, (__m512)a.v)),
                   V(_mm512_mask_blend_pd(mask.v, (__m512d)b.v, (__m512d)a.v)))
  if constexpr (!has_mask_register(N * sizeof(T))) {
    return Pack<T, N>(mask.v ? a.v : b.v);
  }
}

/// Semantics of math::min and max: b where either is NaN.
template <class T, int N>
JADE_HD Pack<T, N> min(Pack<T, N> a, Pack<T, N> b) {
  using V [[maybe_unused]] = typename Pack<T, N>::Vector;
  JADE_WITH_AVX(V(_mm256_min_ps((__m256)a.v, (__m256)b.v)),
                V(_mm256_min_pd((__m256d)a.v, (__m256d)b.v)))
  JADE_WITH_AVX512(V(_mm512_min_ps((__m512)a.v, (__m512)b.v)),
                   V(_mm512_min_pd((__m512d)a.v, (__m512d)b.v)))
  return select(a < b, a, b);
}
template <class T, int N>
JADE_HD Pack<T, N> max(Pack<T, N> a, Pack<T, N> b) {
  using V [[maybe_unused]] = typename Pack<T, N>::Vector;
  JADE_WITH_AVX(V(_mm256_max_ps((__m256)a.v, (__m256)b.v)),
                V(_mm256_max_pd((__m256d)a.v, (__m256d)b.v)))
  JADE_WITH_AVX512(V(_mm512_max_ps((__m512)a.v, (__m512)b.v)),
                   V(_mm512_max_pd((__m512d)a.v, (__m512d)b.v)))
  return select(a > b, a, b);
}

/// a where the mask holds, else +0.
template <class T, int N>
JADE_HD Pack<T, N> keep(PackMask<T, N> mask, Pack<T, N> a) {
  using P = Pack<T, N>;
  using V [[maybe_unused]] = typename P::Vector;
  JADE_WITH_AVX512(V(_mm512_maskz_mov_ps(mask.v, (__m512)a.v)),
                   V(_mm512_maskz_mov_pd(mask.v, (__m512d)a.v)))
  if constexpr (!has_mask_register(N * sizeof(T))) {
    return P((V)((typename P::IntVector)a.v & mask.v));
  }
}

/// −|a|: sets the sign bit.
template <class T, int N>
JADE_HD Pack<T, N> make_negative(Pack<T, N> a) {
  using P = Pack<T, N>;
  const P sign(T(-0.0));
  return P((typename P::Vector)((typename P::IntVector)a.v | (typename P::IntVector)sign.v));
}

template <class T, int N>
JADE_HD Pack<T, N> sqrt(Pack<T, N> a) {
  using V [[maybe_unused]] = typename Pack<T, N>::Vector;
  JADE_WITH_AVX(V(_mm256_sqrt_ps((__m256)a.v)), V(_mm256_sqrt_pd((__m256d)a.v)))
  JADE_WITH_AVX512(V(_mm512_sqrt_ps((__m512)a.v)), V(_mm512_sqrt_pd((__m512d)a.v)))
  for (int i = 0; i < N; ++i) a.v[i] = sqrt(T(a.v[i]));
  return a;
}

template <class T, int N>
JADE_HD Pack<T, N> fma(Pack<T, N> a, Pack<T, N> b, Pack<T, N> c) {
  using V [[maybe_unused]] = typename Pack<T, N>::Vector;
  JADE_WITH_AVX(V(_mm256_fmadd_ps((__m256)a.v, (__m256)b.v, (__m256)c.v)),
                V(_mm256_fmadd_pd((__m256d)a.v, (__m256d)b.v, (__m256d)c.v)))
  JADE_WITH_AVX512(V(_mm512_fmadd_ps((__m512)a.v, (__m512)b.v, (__m512)c.v)),
                   V(_mm512_fmadd_pd((__m512d)a.v, (__m512d)b.v, (__m512d)c.v)))
  return a * b + c;
}

/// One bit per lane, lane 0 lowest.
template <class T, int N>
JADE_HD uint32_t bits(PackMask<T, N> mask) {
  JADE_WITH_AVX(static_cast<uint32_t>(_mm256_movemask_ps((__m256)mask.v)),
                static_cast<uint32_t>(_mm256_movemask_pd((__m256d)mask.v)))
  JADE_WITH_AVX512(static_cast<uint32_t>(mask.v), static_cast<uint32_t>(mask.v))
  if constexpr (!has_mask_register(N * sizeof(T))) {
    uint32_t result = 0;
    for (int i = 0; i < N; ++i) result |= static_cast<uint32_t>(mask.v[i] & 1) << i;
    return result;
  }
}

template <class T, int N>
JADE_HD T sum(Pack<T, N> a) {
  if constexpr (N == 1) {
    return a.v[0];
  } else {
    typedef T Half __attribute__((vector_size(N / 2 * sizeof(T))));
    Half halves[2];
    std::memcpy(halves, &a.v, sizeof(a.v));
    return sum(Pack<T, N / 2>(halves[0] + halves[1]));
  }
}

/// out[i] = sum(packs[i]).
template <class T, int N>
JADE_HD void store_sums(const Pack<T, N> (&packs)[8], T* out) {
  for (int i = 0; i < 8; ++i) out[i] = sum(packs[i]);
}

#if defined(__AVX512F__)
/// Adds while transposing: 23 instructions instead of 64.
JADE_HD void store_sums(const Pack<float, 16> (&packs)[8], float* out) {
  __m512 four[2];  // a quarter for each pack
  for (int i = 0; i < 2; ++i) {
    const auto halves = [&](int k) {
      const __m512 a = (__m512)packs[k].v, b = (__m512)packs[k + 1].v;
      return _mm512_add_ps(_mm512_shuffle_f32x4(a, b, 0x44), _mm512_shuffle_f32x4(a, b, 0xee));
    };
    const __m512 ab = halves(4 * i), cd = halves(4 * i + 2);
    four[i] = _mm512_add_ps(_mm512_shuffle_f32x4(ab, cd, 0x88), _mm512_shuffle_f32x4(ab, cd, 0xdd));
  }
  const __m512 pairs =
      _mm512_add_ps(_mm512_unpacklo_ps(four[0], four[1]), _mm512_unpackhi_ps(four[0], four[1]));
  const __m512 all = _mm512_add_ps(pairs, _mm512_permute_ps(pairs, 0x4e));
  const __m512i order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 0, 0, 0, 0, 0, 0, 0, 0);
  _mm256_storeu_ps(out, _mm512_castps512_ps256(_mm512_permutexvar_ps(order, all)));
}
#endif

/// Whether there is a transpose() of as many packs as they have lanes.
template <class P>
constexpr bool kCanTranspose = false;

#if defined(__AVX512F__)
template <>
inline constexpr bool kCanTranspose<Pack<float, 16>> = true;

/// Moves lane j of pack i to lane i of pack j: 64 instructions instead of 256 loads and stores.
JADE_HD void transpose(Pack<float, 16> (&packs)[16]) {
  __m512 pairs[16], fours[16];  // of rows, side by side in each quarter
  for (int i = 0; i < 16; i += 2) {
    const __m512 a = (__m512)packs[i].v, b = (__m512)packs[i + 1].v;
    pairs[i] = _mm512_unpacklo_ps(a, b);
    pairs[i + 1] = _mm512_unpackhi_ps(a, b);
  }
  for (int i = 0; i < 16; i += 4) {
    for (int half = 0; half < 2; ++half) {
      const __m512d a = (__m512d)pairs[i + half], b = (__m512d)pairs[i + half + 2];
      fours[i + 2 * half] = (__m512)_mm512_unpacklo_pd(a, b);
      fours[i + 2 * half + 1] = (__m512)_mm512_unpackhi_pd(a, b);
    }
  }
  for (int k = 0; k < 4; ++k) {
    const __m512 a = _mm512_shuffle_f32x4(fours[k], fours[4 + k], 0x88);
    const __m512 b = _mm512_shuffle_f32x4(fours[k], fours[4 + k], 0xdd);
    const __m512 c = _mm512_shuffle_f32x4(fours[8 + k], fours[12 + k], 0x88);
    const __m512 d = _mm512_shuffle_f32x4(fours[8 + k], fours[12 + k], 0xdd);
    packs[k].v = _mm512_shuffle_f32x4(a, c, 0x88);
    packs[4 + k].v = _mm512_shuffle_f32x4(b, d, 0x88);
    packs[8 + k].v = _mm512_shuffle_f32x4(a, c, 0xdd);
    packs[12 + k].v = _mm512_shuffle_f32x4(b, d, 0xdd);
  }
}
#endif

/// 2^f for f in [−½, ½]. float: minimax of degree 5 with 1 at 0 (relative error 9e-8 before
/// rounding, 1.7e-7 with it); double: Taylor of degree 13 (2e-17).
template <class T, int N>
JADE_HD Pack<T, N> exp2_fraction(Pack<T, N> f) {
  using P = Pack<T, N>;
  if constexpr (sizeof(T) == 4) {
    P r(1.3264727179726637e-3f);
    r = fma(r, f, P(9.671512640875242e-3f));
    r = fma(r, f, P(5.5507337433100844e-2f));
    r = fma(r, f, P(0.24022242085348366f));
    r = fma(r, f, P(0.693146977599123f));
    return fma(r, f, P(1.0f));
  } else {
    constexpr double kLn2 = 0.6931471805599453;
    double c[14] = {1};
    for (int k = 1; k < 14; ++k) c[k] = c[k - 1] * kLn2 / k;
    P r(c[13]);
    for (int k = 12; k >= 0; --k) r = fma(r, f, P(c[k]));
    return r;
  }
}

/// r · 2^n, where n is a whole number that was rounded by adding `magic`: rounded = n + magic.
template <class T, int N>
JADE_HD Pack<T, N> scale_by_power(Pack<T, N> r, Pack<T, N> rounded) {
  using P = Pack<T, N>;
  typedef typename std::conditional<sizeof(T) == 4, uint32_t, uint64_t>::type U
      __attribute__((vector_size(N * sizeof(T))));
  constexpr int kShift = sizeof(T) == 4 ? 23 : 52;
  return P((typename P::Vector)((U)r.v + ((U)rounded.v << kShift)));
}

template <class T>
constexpr T kRoundingMagic = sizeof(T) == 4 ? T(12582912) : T(6755399441055744);

/// 2^x for −126 ≤ x ≤ 126; unspecified below.
template <class T, int N>
JADE_HD Pack<T, N> exp2(Pack<T, N> x) {
  const Pack<T, N> magic(kRoundingMagic<T>);
  const Pack<T, N> rounded = x + magic;
  return scale_by_power(exp2_fraction(x - (rounded - magic)), rounded);
}

/// e^x, with x clamped to ±87 (float) or ±700 (double).
template <class T, int N>
JADE_HD Pack<T, N> exp(Pack<T, N> x) {
  using P = Pack<T, N>;
  const P bound(sizeof(T) == 4 ? 87.0 : 700.0), magic(kRoundingMagic<T>);
  x = min(max(x, -bound), bound);
  const P rounded = fma(x, P(1.4426950408889634), magic);
  const P n = rounded - magic;
  // ln 2 in two parts, the first with zeros at its end, so that n · ln 2 is exact.
  const P high(sizeof(T) == 4 ? 0.693145751953125 : 0.693147180369123816490);
  const P low(sizeof(T) == 4 ? 1.4286068203094172e-6 : 1.90821492927058770002e-10);
  const P rest = (x - n * high) - n * low;
  return scale_by_power(exp2_fraction(rest * P(1.4426950408889634)), rounded);
}

/// log2 a for a ≥ 2^−126; below, −126 or less, and unspecified for negative a and NaN. float:
/// a = m 2^n with m in [√½, √2), and a polynomial of degree 8 for log2(m) / (m − 1) through
/// Chebyshev's nodes (relative error 3e-8 before rounding); double: lane by lane.
template <class T, int N>
JADE_HD Pack<T, N> log2(Pack<T, N> a) {
  using P = Pack<T, N>;
  if constexpr (sizeof(T) == 4) {
    using Bits = typename VectorOf<uint32_t, N>::Type;
    const auto bits_of_a = (Bits)a.v;
    const auto n = (typename P::IntVector)(bits_of_a - 0x3f3504f3u) >> 23;  // the bits of √½
    const P f = P((typename P::Vector)(bits_of_a - ((Bits)n << 23))) - P(1);
    P r(0.12310968467721937f);
    r = fma(r, f, P(-0.20586188051466936f));
    r = fma(r, f, P(0.21607822552260764f));
    r = fma(r, f, P(-0.2391698814008773f));
    r = fma(r, f, P(0.287903260924363f));
    r = fma(r, f, P(-0.3606932681353216f));
    r = fma(r, f, P(0.48091075345942014f));
    r = fma(r, f, P(-0.7213474682495643f));
    r = fma(r, f, P(1.4426950035679826f));
    return fma(r, f, P(__builtin_convertvector(n, typename P::Vector)));
  } else {
    for (int i = 0; i < N; ++i) a.v[i] = log2(T(a.v[i]));
    return a;
  }
}

}  // namespace JADE_ISA
}  // namespace jade::splat::math
