// SPDX-License-Identifier: Apache-2.0
// What the shared maths needs from its scalar type S. S is float or double on either device, or a
// SIMD pack on the CPU (cpu/pack.h), so every branch on data is a select().
#pragma once

#if defined(__CUDACC__)
#define JADE_HD __host__ __device__ __forceinline__
#else
#define JADE_HD inline __attribute__((always_inline))
#endif

// The CPU kernels compile this maths once per instruction set. Their inline functions must not be
// merged by the linker, so each set has its own (inline) namespace.
#ifndef JADE_SPLAT_ISA
#define JADE_SPLAT_ISA host
#endif

namespace jade::splat::math {
inline namespace JADE_SPLAT_ISA {

#if defined(__CUDA_ARCH__)
JADE_HD float sqrt(float x) { return ::sqrtf(x); }
JADE_HD double sqrt(double x) { return ::sqrt(x); }
JADE_HD float exp(float x) { return ::expf(x); }
JADE_HD double exp(double x) { return ::exp(x); }
JADE_HD float exp2(float x) { return ::exp2f(x); }
JADE_HD double exp2(double x) { return ::exp2(x); }
JADE_HD float log2(float x) { return ::log2f(x); }
JADE_HD double log2(double x) { return ::log2(x); }
JADE_HD float fma(float a, float b, float c) { return ::fmaf(a, b, c); }
JADE_HD double fma(double a, double b, double c) { return ::fma(a, b, c); }
#else
// Built-ins, as the overloads of <cmath> are inline functions that the linker may merge.
JADE_HD float sqrt(float x) { return __builtin_sqrtf(x); }
JADE_HD double sqrt(double x) { return __builtin_sqrt(x); }
JADE_HD float exp(float x) { return __builtin_expf(x); }
JADE_HD double exp(double x) { return __builtin_exp(x); }
JADE_HD float exp2(float x) { return __builtin_exp2f(x); }
JADE_HD double exp2(double x) { return __builtin_exp2(x); }
JADE_HD float log2(float x) { return __builtin_log2f(x); }
JADE_HD double log2(double x) { return __builtin_log2(x); }
JADE_HD float fma(float a, float b, float c) { return a * b + c; }
JADE_HD double fma(double a, double b, double c) { return a * b + c; }
#endif

JADE_HD float select(bool condition, float a, float b) { return condition ? a : b; }
JADE_HD double select(bool condition, double a, double b) { return condition ? a : b; }

template <class S>
JADE_HD S min(S a, S b) {
  return select(a < b, a, b);
}
template <class S>
JADE_HD S max(S a, S b) {
  return select(a > b, a, b);
}
template <class S>
JADE_HD S abs(S a) {
  return select(a < S(0), -a, a);
}

/// False for NaN and for anything beyond `bound`.
template <class S>
JADE_HD auto within(S a, S bound) {
  return (a >= -bound) & (a <= bound);
}

}  // namespace JADE_SPLAT_ISA
}  // namespace jade::splat::math
