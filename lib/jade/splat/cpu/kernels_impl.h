// SPDX-License-Identifier: Apache-2.0
// The CPU kernels as a table, compiled once per instruction set by jade_add_isa_sources().
#pragma once

#include "jade/splat/cpu/blend.h"
#include "jade/splat/cpu/blend_adjoint.h"
#include "jade/splat/cpu/kernels.h"
#include "jade/splat/cpu/pack.h"
#include "jade/splat/cpu/project.h"
#include "jade/splat/cpu/project_adjoint.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

/// A pack has at least four lanes, the width of a block of pixels.
template <class T>
using WidestPack =
    m::Pack<T, (JADE_VECTOR_BYTES / sizeof(T) < 4 ? 4 : JADE_VECTOR_BYTES / sizeof(T))>;

template <class P>
constexpr Kernels<typename P::Scalar> make_kernels() {
  return {project<P>, blend<P>, blend_adjoint<P>, project_adjoint<P>};
}

const KernelSet kKernels = {make_kernels<WidestPack<float>>(), make_kernels<WidestPack<double>>()};

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
