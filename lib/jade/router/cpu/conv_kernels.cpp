// SPDX-License-Identifier: Apache-2.0
// Chooses the instruction set once.
#include "jade/router/cpu/conv_kernels.h"

namespace jade::router {
namespace {

const ConvKernels& kernels() {
#if defined(__x86_64__)
  static const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (avx2) return kAvx2ConvKernels;
#endif
  return kPortableConvKernels;
}

}  // namespace

void convolve(const Convolution<float>& convolution, Band band) {
  kernels().convolve_float(convolution, band);
}
void convolve(const Convolution<double>& convolution, Band band) {
  kernels().convolve_double(convolution, band);
}
void weight_gradient(const WeightGradient<float>& args, Band band, float* of_weights,
                     float* of_bias) {
  kernels().weights_float(args, band, of_weights, of_bias);
}
void weight_gradient(const WeightGradient<double>& args, Band band, double* of_weights,
                     double* of_bias) {
  kernels().weights_double(args, band, of_weights, of_bias);
}

}  // namespace jade::router
