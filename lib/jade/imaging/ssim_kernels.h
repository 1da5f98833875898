// SPDX-License-Identifier: Apache-2.0
// What ssim.cpp asks of its CPU and CUDA kernels. No torch here: the CPU kernels are compiled for
// several instruction sets.
#pragma once

#include <cstdint>

namespace jade::imaging {

constexpr int kSsimRadius = 5;
constexpr int kSsimTaps = 2 * kSsimRadius + 1;
constexpr double kSsimC1 = 1e-4, kSsimC2 = 9e-4;

// With window means μ and E, and
//   A1 = 2 μa μb + C1, A2 = 2 (E[ab] − μa μb) + C2, B1 = μa² + μb² + C1,
//   B2 = E[a²] − μa² + E[b²] − μb² + C2,            S = A1 A2 / (B1 B2),
// the derivatives of S are ∂E[ab] = 2 A1 / (B1 B2), ∂E[a²] = ∂E[b²] = −S / B2 and
//   ∂μa = 2 μb (A2 − A1) / (B1 B2) − 2 μa S (1/B1 − 1/B2).
// The window is symmetric, so Σ S has the gradient G∗∂μa + 2 a G∗∂E[a²] + b G∗∂E[ab].

/// Rows [row_begin, row_end) of one plane. Gradients are of
/// weight_ssim Σ S + weight_l1 Σ |a − b|; null pointers leave a part out.
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
  double* ssim_sums = nullptr;  ///< [H], one a row
  double* l1_sums = nullptr;    ///< [H]
  T* scratch = nullptr;         ///< ssim_scratch_size(width) values
};

/// Five quantities in the forward rings (μa, E[aa], E[ab], μb, E[bb]), up to four derivative maps.
constexpr int kMoments = 5, kMaps = 4;
constexpr int64_t ssim_scratch_size(int64_t width) {
  return (kMoments + kMaps) * kSsimTaps * width + (kMoments + 1) * width +
         kMoments * (width + 2 * kSsimRadius);
}
void ssim_band(const SsimBand<float>& band, const double* window);
void ssim_band(const SsimBand<double>& band, const double* window);

/// Window means of b and b² for rows [row_begin, row_end), into mean_out and square_out.
void ssim_moments(const SsimBand<float>& band, const double* window, float* mean_out,
                  float* square_out);
void ssim_moments(const SsimBand<double>& band, const double* window, double* mean_out,
                  double* square_out);

/// The same four functions for one instruction set.
struct SsimKernels {
  void (*band_float)(const SsimBand<float>&, const double*);
  void (*band_double)(const SsimBand<double>&, const double*);
  void (*moments_float)(const SsimBand<float>&, const double*, float*, float*);
  void (*moments_double)(const SsimBand<double>&, const double*, double*, double*);
};
extern const SsimKernels kPortableSsimKernels;
extern const SsimKernels kAvx2SsimKernels;  ///< x86-64 only

struct SsimCuda {
  const float* a = nullptr;
  const float* b = nullptr;
  const float* mean_b = nullptr;
  const float* square_b = nullptr;
  int64_t planes = 0, height = 0, width = 0;
  float weight_ssim = 0, weight_l1 = 0;
  double offset = 0;
  float* maps = nullptr;  ///< [4 or 3, planes, H, W] when a gradient is wanted
  float* grad_a = nullptr;
  float* grad_b = nullptr;
  double* partial = nullptr;  ///< [ssim_cuda_blocks(...), 2]
  float* value = nullptr;     ///< offset + weight_ssim Σ S + weight_l1 Σ |a − b|
};

int64_t ssim_cuda_blocks(int64_t planes, int64_t height, int64_t width);
/// On the current stream of the device; no waiting. @throws DeviceError.
void ssim_cuda(const SsimCuda& arguments, const double* window, int device_index);

}  // namespace jade::imaging
