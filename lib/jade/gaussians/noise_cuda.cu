// SPDX-License-Identifier: Apache-2.0
#include <c10/cuda/CUDAStream.h>

#include "jade/gaussians/noise_math.h"
#include "jade/kernel/launch.h"

namespace jade::gaussians::cuda {
namespace {

constexpr int kThreads = 256;

__global__ void noise_kernel(NoiseStep step) {
  const int64_t row = int64_t{blockIdx.x} * kThreads + threadIdx.x;
  if (row < step.count) add_noise_to(step, row);
}

}  // namespace

void add_noise(const NoiseStep& step) {
  if (step.count == 0) return;
  noise_kernel<<<kernel::grid_size(step.count, kThreads), kThreads, 0,
                 c10::cuda::getCurrentCUDAStream()>>>(step);
  kernel::check_launch("the noise of the Gaussians");
}

}  // namespace jade::gaussians::cuda
