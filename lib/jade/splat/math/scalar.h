// SPDX-License-Identifier: Apache-2.0
// Requirements of the shared maths on its scalar type S: float or double on either device, or a
// SIMD pack on the CPU (cpu/pack.h), so every branch on data is a select().
#pragma once

#include "jade/kernel/host_device.h"

namespace jade::splat::math {
inline namespace JADE_ISA {

// Declared beside the overloads for packs, which would hide them.
using kernel::abs;
using kernel::exp;
using kernel::exp2;
using kernel::fma;
using kernel::log2;
using kernel::max;
using kernel::min;
using kernel::select;
using kernel::sqrt;
using kernel::within;

/// a where the condition holds, else +0.
JADE_HD float keep(bool condition, float a) { return condition ? a : 0.0f; }
JADE_HD double keep(bool condition, double a) { return condition ? a : 0.0; }

/// −|a|
#if defined(__CUDA_ARCH__)
JADE_HD float make_negative(float a) { return -::fabsf(a); }
JADE_HD double make_negative(double a) { return -::fabs(a); }
#else
JADE_HD float make_negative(float a) { return -__builtin_fabsf(a); }
JADE_HD double make_negative(double a) { return -__builtin_fabs(a); }
#endif

}  // namespace JADE_ISA
}  // namespace jade::splat::math
