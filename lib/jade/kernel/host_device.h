// SPDX-License-Identifier: Apache-2.0
// Shared by host and device code of an op (op_math.h): a macro for its functions, and scalar math
// functions.
#pragma once

#if defined(__CUDACC__)
#define JADE_HD __host__ __device__ __forceinline__
#else
#define JADE_HD inline __attribute__((always_inline))
#endif

// Sources of jade_add_isa_sources() are compiled once per instruction set. The linker would merge
// inline functions of the same name, so each instruction set has its own inline namespace, and so
// do sources that are compiled once.
#ifndef JADE_ISA
#if defined(__CUDACC__)
#define JADE_ISA gpu
#else
#define JADE_ISA host
#endif
#endif

namespace jade::kernel {
inline namespace JADE_ISA {

#if defined(__CUDA_ARCH__)
JADE_HD float sqrt(float x) { return ::sqrtf(x); }
JADE_HD double sqrt(double x) { return ::sqrt(x); }
JADE_HD float floor(float x) { return ::floorf(x); }
JADE_HD float exp(float x) { return ::expf(x); }
JADE_HD double exp(double x) { return ::exp(x); }
JADE_HD float exp2(float x) { return ::exp2f(x); }
JADE_HD double exp2(double x) { return ::exp2(x); }
JADE_HD double log(double x) { return ::log(x); }
JADE_HD float log2(float x) { return ::log2f(x); }
JADE_HD double log2(double x) { return ::log2(x); }
JADE_HD float sin(float x) { return ::sinf(x); }
JADE_HD float cos(float x) { return ::cosf(x); }
JADE_HD double pow(double base, double exponent) { return ::pow(base, exponent); }
JADE_HD float fma(float a, float b, float c) { return ::fmaf(a, b, c); }
JADE_HD double fma(double a, double b, double c) { return ::fma(a, b, c); }
#else
// Built-ins, because the linker may merge the inline overloads of <cmath>.
JADE_HD float sqrt(float x) { return __builtin_sqrtf(x); }
JADE_HD double sqrt(double x) { return __builtin_sqrt(x); }
JADE_HD float floor(float x) { return __builtin_floorf(x); }
JADE_HD float exp(float x) { return __builtin_expf(x); }
JADE_HD double exp(double x) { return __builtin_exp(x); }
JADE_HD float exp2(float x) { return __builtin_exp2f(x); }
JADE_HD double exp2(double x) { return __builtin_exp2(x); }
JADE_HD double log(double x) { return __builtin_log(x); }
JADE_HD float log2(float x) { return __builtin_log2f(x); }
JADE_HD double log2(double x) { return __builtin_log2(x); }
JADE_HD float sin(float x) { return __builtin_sinf(x); }
JADE_HD float cos(float x) { return __builtin_cosf(x); }
JADE_HD double pow(double base, double exponent) { return __builtin_pow(base, exponent); }
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

/// Returns false for NaN and for values beyond `bound`.
template <class S>
JADE_HD auto within(S a, S bound) {
  return (a >= -bound) & (a <= bound);
}

}  // namespace JADE_ISA
}  // namespace jade::kernel
