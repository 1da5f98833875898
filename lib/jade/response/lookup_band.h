// SPDX-License-Identifier: Apache-2.0
// ρ and its adjoint for a run of values on the CPU. Must not include torch: the kernels are
// compiled for several instruction sets.
#pragma once

#include <cstdint>

#include "jade/kernel/isa.h"
#include "jade/response/lookup_math.h"

namespace jade::response {

/// Consecutive values, and their lookup table.
template <class T>
struct LookupRun {
  const T* image = nullptr;
  const T* table = nullptr;  ///< [kKnots]
  int64_t count = 0;
  T weight = 1;
};

template <class T>
struct LookupKernels {
  /// out = ρ(x); the weight is not read.
  void (*values)(const LookupRun<T>& run, T* out);
  /// out += weight · ρ(x).
  void (*add_values)(const LookupRun<T>& run, T* out);
  /// From the gradient of weight · ρ(x): writes of_image; adds to of_cells [kKnots, 2], Σ g and Σ g
  /// · fraction of each cell. Either may be null.
  void (*gradients)(const LookupRun<T>& run, const T* gradient, T* of_image, double* of_cells);
};
using LookupKernelSet = kernel::KernelSet<LookupKernels>;

namespace portable {
extern const LookupKernelSet kLookupKernels;
}
namespace avx2 {
extern const LookupKernelSet kLookupKernels;
}
namespace avx512 {
extern const LookupKernelSet kLookupKernels;
}

/// The kernels for kernel::chosen_isa().
const LookupKernelSet& lookup_kernels();

}  // namespace jade::response
