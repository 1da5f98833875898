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

template <class P>
constexpr Kernels<typename P::Scalar> make_kernels() {
  return {project<P>, blend<P>, blend_adjoint<P>, project_adjoint<P>};
}

// A splat's row is about ten pixels long: packs of more than 32 bytes run half empty.
constexpr int kPackBytes = JADE_VECTOR_BYTES < 32 ? JADE_VECTOR_BYTES : 32;

const KernelSet kKernels = {make_kernels<m::Pack<float, kPackBytes / sizeof(float)>>(),
                            make_kernels<m::Pack<double, kPackBytes / sizeof(double)>>()};

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
