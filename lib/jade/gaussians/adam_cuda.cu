// SPDX-License-Identifier: Apache-2.0
#include <c10/cuda/CUDAStream.h>

#include "jade/gaussians/adam_math.h"
#include "jade/kernel/launch.h"

namespace jade::gaussians::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kPerThread = 4;

struct Shared {
  float inverse_sqrt_correction2;
  float head_lr, tail_lr;
};

__device__ float gradient_of(const AdamGroup& group, int64_t i) {
  return group.tied ? tied_gradient(group.gradient + (i - i % 3)) : group.gradient[i];
}

/// A block handles kThreads · kPerThread floats of one group. Everything that changes from step to
/// step is computed from the device's step counter, so that the launch can be replayed.
__global__ void adam_kernel(AdamStep step) {
  __shared__ Shared shared;
  int64_t block = blockIdx.x;
  int index = 0;
  constexpr int64_t kFloats = kThreads * kPerThread;
  while (block >= kernel::block_count(step.groups[index].count, kFloats)) {
    block -= kernel::block_count(step.groups[index].count, kFloats);
    ++index;
  }
  const AdamGroup& group = step.groups[index];
  if (threadIdx.x == 0) {
    const double factor = rate_factor(step, group.scheduled);
    shared.inverse_sqrt_correction2 = inverse_sqrt_correction2(step);
    shared.head_lr = static_cast<float>(group.head_lr * factor);
    shared.tail_lr = static_cast<float>(group.tail_lr * factor);
  }
  __syncthreads();
  const AdamConstants constants = adam_constants(step, shared.inverse_sqrt_correction2);
  for (int k = 0; k < kPerThread; ++k) {
    const int64_t i = block * kFloats + k * kThreads + threadIdx.x;
    if (i >= group.count) return;
    // All that comes from memory is asked for before the division that in_head() may need.
    const float g = gradient_of(group, i);
    float value = group.value[i], first = group.first[i], second = group.second[i];
    const float lr = in_head(group, i) ? shared.head_lr : shared.tail_lr;
    adam_update(constants, lr, g, value, first, second);
    group.first[i] = first;
    group.second[i] = second;
    group.value[i] = value;
  }
}

}  // namespace

void adam_step(const AdamStep& step) {
  int64_t blocks = 0;
  for (int i = 0; i < step.group_count; ++i) {
    blocks += kernel::block_count(step.groups[i].count, kThreads * kPerThread);
  }
  if (blocks == 0) return;
  adam_kernel<<<static_cast<unsigned>(blocks), kThreads, 0, c10::cuda::getCurrentCUDAStream()>>>(
      step);
  kernel::check_launch("the Adam step of the Gaussians");
}

}  // namespace jade::gaussians::cuda
