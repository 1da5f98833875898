// SPDX-License-Identifier: Apache-2.0
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/kernel/launch.h"
#include "jade/losses/poses_kernels.h"

namespace jade::losses::cuda {
namespace {

constexpr int kThreads = 256;

struct Picks {
  const int64_t* indices;
  int64_t first;
  const float* weights;
  int64_t renders;  ///< K
  int count;
  float* images[kMostPicks];  ///< picked images, or their gradients; null: none

  __device__ int64_t pose(int m) const {
    if (first < 0) return __ldg(indices + m);
    return m == 0 ? first : __ldg(indices + m - 1);
  }
  /// Weight of render k in the mean.
  __device__ float weight(int64_t k) const {
    return weights != nullptr ? __ldg(weights + k) : 1.0f / static_cast<float>(renders);
  }
};

/// One thread per value of one image. The loads of all renders overlap.
__global__ void __launch_bounds__(kThreads)
    views_kernel(const __grid_constant__ Picks picks, const float* __restrict__ renders,
                 float* __restrict__ mean, int64_t values) {
  const int64_t i = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (i >= values) return;
  float sum = 0;
#pragma unroll 8
  for (int64_t k = 0; k < picks.renders; ++k) sum += picks.weight(k) * renders[k * values + i];
  mean[i] = sum;
  for (int m = 0; m < picks.count; ++m) picks.images[m][i] = renders[picks.pose(m) * values + i];
}

__global__ void __launch_bounds__(kThreads)
    gradient_kernel(const __grid_constant__ Picks picks, const float* __restrict__ of_mean,
                    const float* __restrict__ of_all, float* __restrict__ of_renders,
                    int64_t values) {
  const int64_t i = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (i >= values) return;
  const float mean = of_mean != nullptr ? of_mean[i] : 0.f;
  float of_pick[kMostPicks];
  int pose[kMostPicks];
#pragma unroll
  for (int m = 0; m < kMostPicks; ++m) {
    const bool there = m < picks.count && picks.images[m] != nullptr;
    of_pick[m] = there ? picks.images[m][i] : 0.f;
    pose[m] = there ? static_cast<int>(picks.pose(m)) : -1;
  }
  const int renders = static_cast<int>(picks.renders);
#pragma unroll 4
  for (int k = 0; k < renders; ++k) {
    const float all = of_all != nullptr ? of_all[k * values + i] : 0.f;
    float sum = picks.weight(k) * mean;
    // In order, so that sums over repeated poses are deterministic.
#pragma unroll
    for (int m = 0; m < kMostPicks; ++m) {
      if (pose[m] == k) sum += of_pick[m];
    }
    of_renders[k * values + i] = sum + all;
  }
}

Picks picks_of(const PosePicks& picks, int64_t renders) {
  Picks out{};
  out.indices = picks.indices.const_data_ptr<int64_t>();
  out.first = picks.first;
  out.weights = picks.weights.defined() ? picks.weights.const_data_ptr<float>() : nullptr;
  out.renders = renders;
  out.count = static_cast<int>(picks.count());
  return out;
}

}  // namespace

void pose_views(const PosePicks& picks, const at::Tensor& renders, at::Tensor& mean,
                std::vector<at::Tensor>& picked) {
  const int64_t values = mean.numel();
  if (values == 0) return;
  const c10::cuda::CUDAGuard guard(renders.device());
  Picks job = picks_of(picks, renders.size(0));
  for (size_t m = 0; m < picked.size(); ++m) {
    job.images[m] = picked[m].mutable_data_ptr<float>();
  }
  views_kernel<<<kernel::grid_size(values, kThreads), kThreads, 0,
                 c10::cuda::getCurrentCUDAStream()>>>(job, renders.const_data_ptr<float>(),
                                                      mean.mutable_data_ptr<float>(), values);
  kernel::check_launch("the mean of the renders");
}

void pose_gradient(const PosePicks& picks, const PoseGradients& of, at::Tensor& of_renders) {
  if (of_renders.numel() == 0) return;
  const c10::cuda::CUDAGuard guard(of_renders.device());
  const int64_t values = of_renders.numel() / of_renders.size(0);
  Picks job = picks_of(picks, of_renders.size(0));
  const auto values_of = [](const at::Tensor& gradient) {
    return gradient.defined() ? gradient.const_data_ptr<float>() : nullptr;
  };
  for (size_t m = 0; m < of.picks.size(); ++m) {
    job.images[m] = const_cast<float*>(values_of(of.picks[m]));
  }
  gradient_kernel<<<kernel::grid_size(values, kThreads), kThreads, 0,
                    c10::cuda::getCurrentCUDAStream()>>>(
      job, values_of(of.mean), values_of(of.all), of_renders.mutable_data_ptr<float>(), values);
  kernel::check_launch("the mean of the renders, backward");
}

}  // namespace jade::losses::cuda
