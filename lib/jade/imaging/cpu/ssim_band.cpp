// SPDX-License-Identifier: Apache-2.0
// Chooses the instruction set once.
#include "jade/imaging/ssim_kernels.h"

namespace jade::imaging {
namespace {

const SsimKernels& kernels() {
#if defined(__x86_64__)
  static const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (avx2) return kAvx2SsimKernels;
#endif
  return kPortableSsimKernels;
}

}  // namespace

void ssim_band(const SsimBand<float>& band, const double* window) {
  kernels().band_float(band, window);
}
void ssim_band(const SsimBand<double>& band, const double* window) {
  kernels().band_double(band, window);
}
void ssim_moments(const SsimBand<float>& band, const double* window, float* mean_out,
                  float* square_out) {
  kernels().moments_float(band, window, mean_out, square_out);
}
void ssim_moments(const SsimBand<double>& band, const double* window, double* mean_out,
                  double* square_out) {
  kernels().moments_double(band, window, mean_out, square_out);
}

}  // namespace jade::imaging
