// SPDX-License-Identifier: Apache-2.0
// SSIM on the CPU, in bands of rows. Must not include torch: the kernels are compiled for several
// instruction sets.
#pragma once

#include <cstdint>

#include "jade/imaging/ssim_math.h"
#include "jade/kernel/isa.h"

namespace jade::imaging {

/// Rows [row_begin, row_end) of one plane. Gradients are of
/// weight_ssim Σ S + weight_l1 Σ |a − b|; parts with null pointers are skipped.
template <class T>
struct SsimBand {
  const T* a = nullptr;
  const T* b = nullptr;
  const T* mean_b = nullptr;  ///< window means of b and b², or both null
  const T* square_b = nullptr;
  int64_t height = 0, width = 0, row_begin = 0, row_end = 0;
  T weight_ssim = 0, weight_l1 = 0;
  T* grad_a = nullptr;
  T* grad_b = nullptr;
  double* ssim_sums = nullptr;  ///< [H], one per row
  double* l1_sums = nullptr;    ///< [H]
  T* scratch = nullptr;         ///< ssim_scratch_size(width) values
};

/// Five quantities in the forward ring buffers (μa, E[aa], E[ab], μb, E[bb]), up to four derivative
/// maps.
constexpr int kMoments = 5, kMaps = 4;
constexpr int64_t ssim_scratch_size(int64_t width) {
  return (kMoments + kMaps) * kSsimTaps * width + (kMoments + 1) * width +
         kMoments * (width + 2 * kSsimRadius);
}

template <class T>
struct SsimKernels {
  void (*band)(const SsimBand<T>&, const double* window);
  /// Window means of b and b² for rows [row_begin, row_end).
  void (*moments)(const SsimBand<T>&, const double* window, T* mean_out, T* square_out);
};
using SsimKernelSet = kernel::KernelSet<SsimKernels>;

namespace portable {
extern const SsimKernelSet kSsimKernels;
}
namespace avx2 {
extern const SsimKernelSet kSsimKernels;
}
namespace avx512 {
extern const SsimKernelSet kSsimKernels;
}

/// The kernels for kernel::chosen_isa().
const SsimKernelSet& ssim_kernels();

}  // namespace jade::imaging
