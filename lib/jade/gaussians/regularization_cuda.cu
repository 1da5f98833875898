// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <algorithm>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/gaussians/regularization_kernels.h"
#include "jade/kernel/block_sum.cuh"
#include "jade/kernel/launch.h"

namespace jade::gaussians::cuda {
namespace {

constexpr int kThreads = 256;

/// Few enough that the second kernel, a single block, has little to add.
constexpr int64_t kMostBlocks = 264;

struct Numbers {
  const float* logits;
  const float* log_scales;
  int64_t logit_count, log_scale_count;
  double of_opacity, of_scale;  ///< weight / count
};

Numbers numbers_of(const Regularized& in) {
  const int64_t opacities = in.logit_opacities.numel(), scales = in.log_scales.numel();
  return {in.logit_opacities.const_data_ptr<float>(),
          in.log_scales.const_data_ptr<float>(),
          opacities,
          scales,
          in.opacity_weight / static_cast<double>(opacities),
          in.scale_weight / static_cast<double>(scales)};
}

/// @param parts  [blocks]
__global__ void __launch_bounds__(kThreads) parts_kernel(Numbers in, double* parts) {
  const int64_t stride = gridDim.x * static_cast<int64_t>(kThreads);
  const int64_t first = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  double opacity = 0, scale = 0;
  for (int64_t i = first; i < in.logit_count; i += stride) opacity += opacity_of(in.logits[i]);
  for (int64_t i = first; i < in.log_scale_count; i += stride) {
    scale += kernel::exp(in.log_scales[i]);
  }
  double of_thread[1] = {in.of_opacity * opacity + in.of_scale * scale}, of_block[1];
  kernel::block_sum<kThreads>(of_thread, of_block);
  if (threadIdx.x == 0) parts[blockIdx.x] = of_block[0];
}

/// A single block, which always adds in the same order.
__global__ void __launch_bounds__(kThreads)
    sum_kernel(const double* parts, int blocks, float* value) {
  double of_thread[1] = {0}, total[1];
  for (int block = threadIdx.x; block < blocks; block += kThreads) of_thread[0] += parts[block];
  kernel::block_sum<kThreads>(of_thread, total);
  if (threadIdx.x == 0) *value = static_cast<float>(total[0]);
}

__global__ void __launch_bounds__(kThreads)
    gradient_kernel(Numbers in, const float* of_value, float* of_logits, float* of_log_scales) {
  const int64_t i = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  const double of = *of_value;
  if (i < in.logit_count) {
    of_logits[i] = static_cast<float>(of * in.of_opacity) * opacity_slope(in.logits[i]);
  }
  if (i < in.log_scale_count) {
    of_log_scales[i] = static_cast<float>(of * in.of_scale) * kernel::exp(in.log_scales[i]);
  }
}

int64_t most(const Numbers& in) { return std::max(in.logit_count, in.log_scale_count); }

}  // namespace

void regularization(const Regularized& in, at::Tensor& value) {
  const c10::cuda::CUDAGuard guard(value.device());
  const auto stream = c10::cuda::getCurrentCUDAStream();
  const Numbers numbers = numbers_of(in);
  const int64_t blocks = std::min(kMostBlocks, kernel::block_count(most(numbers), kThreads));
  const at::Tensor parts = at::empty({blocks}, value.options().dtype(at::kDouble));
  parts_kernel<<<static_cast<unsigned>(blocks), kThreads, 0, stream>>>(
      numbers, parts.mutable_data_ptr<double>());
  sum_kernel<<<1, kThreads, 0, stream>>>(parts.const_data_ptr<double>(), static_cast<int>(blocks),
                                         value.mutable_data_ptr<float>());
  kernel::check_launch("the regularization of MCMC");
}

void regularization_gradient(const Regularized& in, const at::Tensor& of_value,
                             at::Tensor& of_logits, at::Tensor& of_log_scales) {
  const c10::cuda::CUDAGuard guard(of_value.device());
  const Numbers numbers = numbers_of(in);
  gradient_kernel<<<kernel::grid_size(most(numbers), kThreads), kThreads, 0,
                    c10::cuda::getCurrentCUDAStream()>>>(numbers, of_value.const_data_ptr<float>(),
                                                         of_logits.mutable_data_ptr<float>(),
                                                         of_log_scales.mutable_data_ptr<float>());
  kernel::check_launch("the regularization of MCMC, backward");
}

}  // namespace jade::gaussians::cuda
