// SPDX-License-Identifier: Apache-2.0
#include <c10/cuda/CUDAStream.h>

#include "jade/gaussians/adam.h"
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
  if (!group.tied) return group.gradient[i];
  const float* three = group.gradient + (i - i % 3);
  return (three[0] + three[1] + three[2]) / 3;
}

/// A block handles kThreads · kPerThread floats of one group. Everything that changes from step to
/// step is computed from the device's step counter, so that the launch can be replayed.
__global__ void adam_kernel(AdamStep step) {
  __shared__ Shared shared;
  int64_t block = blockIdx.x;
  int index = 0;
  constexpr int64_t kFloats = kThreads * kPerThread;
  while (block >= (step.groups[index].count + kFloats - 1) / kFloats) {
    block -= (step.groups[index].count + kFloats - 1) / kFloats;
    ++index;
  }
  const AdamGroup& group = step.groups[index];
  if (threadIdx.x == 0) {
    const double steps = static_cast<double>(*step.step);
    const double correction1 = 1 - pow(step.beta1, steps);
    const double s = fmin(steps / step.max_steps, 1.0);
    const double schedule = exp(step.log_start + (step.log_end - step.log_start) * s);
    const double factor = (group.scheduled ? schedule : 1.0) / correction1;
    shared.inverse_sqrt_correction2 = static_cast<float>(1 / sqrt(1 - pow(step.beta2, steps)));
    shared.head_lr = static_cast<float>(group.head_lr * factor);
    shared.tail_lr = static_cast<float>(group.tail_lr * factor);
  }
  __syncthreads();
  const float beta1 = static_cast<float>(step.beta1);
  const float beta2 = static_cast<float>(step.beta2);
  const float one_minus_beta1 = static_cast<float>(1 - step.beta1);
  const float one_minus_beta2 = static_cast<float>(1 - step.beta2);
  const float eps = static_cast<float>(step.eps);
  for (int k = 0; k < kPerThread; ++k) {
    const int64_t i = block * kFloats + k * kThreads + threadIdx.x;
    if (i >= group.count) return;
    const float g = gradient_of(group, i);
    const float m = beta1 * group.first[i] + one_minus_beta1 * g;
    const float v = beta2 * group.second[i] + one_minus_beta2 * g * g;
    group.first[i] = m;
    group.second[i] = v;
    const bool in_head = group.head == group.row || i % group.row < group.head;
    const float lr = in_head ? shared.head_lr : shared.tail_lr;
    group.value[i] -= lr * m / (sqrtf(v) * shared.inverse_sqrt_correction2 + eps);
  }
}

}  // namespace

void adam_step(const AdamStep& step) {
  int64_t blocks = 0;
  for (int i = 0; i < step.group_count; ++i) {
    blocks += (step.groups[i].count + kThreads * kPerThread - 1) / (kThreads * kPerThread);
  }
  if (blocks == 0) return;
  adam_kernel<<<static_cast<unsigned>(blocks), kThreads, 0, c10::cuda::getCurrentCUDAStream()>>>(
      step);
  kernel::check_launch("the Adam step of the Gaussians");
}

}  // namespace jade::gaussians::cuda
