// SPDX-License-Identifier: Apache-2.0
#include <c10/cuda/CUDAStream.h>

#include "jade/gaussians/adam_math.h"
#include "jade/kernel/launch.h"

namespace jade::gaussians::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kPerThread = 4;  ///< consecutive floats, for one access of 16 bytes
constexpr int kFloats = kThreads * kPerThread;

/// Counts the step, and computes the factors that all of its floats share, because powers in double
/// take longer than a block's loads: rate_factor() without and with the schedule,
/// inverse_sqrt_correction2(). Values that change from step to step come from the device's counter,
/// so that both launches can be replayed.
__global__ void rates_kernel(const __grid_constant__ AdamStep step) {
  if (threadIdx.x == 0) ++*step.step;
  __syncwarp();
  if (threadIdx.x < 2) step.rates[threadIdx.x] = rate_factor(step, threadIdx.x == 1);
  if (threadIdx.x == 2) step.rates[2] = inverse_sqrt_correction2(step);
}

/// A thread's floats of one tensor.
struct Four {
  float at[kPerThread];
};
static_assert(sizeof(Four) == sizeof(float4), "loaded and stored as one");

/// Loads `count` floats or, if `whole`, four by one vectorised access.
__device__ __forceinline__ Four load(const float* from, int count, bool whole) {
  Four to{};
  if (whole) {
    const float4 four = *reinterpret_cast<const float4*>(from);
    to = {four.x, four.y, four.z, four.w};
  } else {
    for (int k = 0; k < kPerThread; ++k) {
      if (k < count) to.at[k] = from[k];
    }
  }
  return to;
}

__device__ __forceinline__ void store(const Four& from, int count, bool whole, float* to) {
  if (whole) {
    *reinterpret_cast<float4*>(to) = make_float4(from.at[0], from.at[1], from.at[2], from.at[3]);
  } else {
    for (int k = 0; k < kPerThread; ++k) {
      if (k < count) to[k] = from.at[k];
    }
  }
}

__device__ __forceinline__ bool aligned(const AdamGroup& group) {
  const auto bits = [](const void* at) { return reinterpret_cast<unsigned long long>(at); };
  return (bits(group.value) | bits(group.first) | bits(group.second) | bits(group.gradient)) %
             sizeof(float4) ==
         0;
}

/// One block handles kFloats floats of one group.
__global__ void __launch_bounds__(kThreads) adam_kernel(const __grid_constant__ AdamStep step) {
  int64_t block = blockIdx.x;
  int index = 0;
  while (block >= kernel::block_count(step.groups[index].count, kFloats)) {
    block -= kernel::block_count(step.groups[index].count, kFloats);
    ++index;
  }
  const AdamGroup& group = step.groups[index];
  const uint32_t in_block = threadIdx.x * kPerThread;
  const int64_t i = block * kFloats + in_block, left = group.count - i;
  if (left <= 0) return;
  const int count = left < kPerThread ? static_cast<int>(left) : kPerThread;
  const bool whole = count == kPerThread && aligned(group);
  const Four gradient = load(group.gradient + i, count, whole);
  Four value = load(group.value + i, count, whole), first = load(group.first + i, count, whole),
       second = load(group.second + i, count, whole);
  const AdamConstants constants = adam_constants(step, static_cast<float>(__ldg(step.rates + 2)));
  const double factor = __ldg(step.rates + (group.scheduled ? 1 : 0));
  const auto head_lr = static_cast<float>(group.head_lr * factor);
  const auto tail_lr = static_cast<float>(group.tail_lr * factor);
  const auto row = static_cast<uint32_t>(group.row), head = static_cast<uint32_t>(group.head);
  uint32_t in_row = 0;
  if (head != row) {
    // In 32 bits: a 64-bit division takes as long as all other work.
    in_row = (static_cast<uint32_t>(block) % row * uint32_t{kFloats} + in_block) % row;
  }
#pragma unroll
  for (int k = 0; k < kPerThread; ++k) {
    const int64_t three = (i + k) - (i + k) % 3;
    const float g =
        group.tied && k < count ? tied_gradient(group.gradient + three) : gradient.at[k];
    adam_update(constants, in_row < head ? head_lr : tail_lr, g, value.at[k], first.at[k],
                second.at[k]);
    if (++in_row == row) in_row = 0;
  }
  store(first, count, whole, group.first + i);
  store(second, count, whole, group.second + i);
  store(value, count, whole, group.value + i);
}

}  // namespace

void adam_step(const AdamStep& step) {
  int64_t blocks = 0;
  for (int i = 0; i < step.group_count; ++i) {
    blocks += kernel::block_count(step.groups[i].count, kFloats);
  }
  const auto stream = c10::cuda::getCurrentCUDAStream();
  rates_kernel<<<1, 32, 0, stream>>>(step);
  if (blocks > 0) {
    adam_kernel<<<static_cast<unsigned>(blocks), kThreads, 0, stream>>>(step);
  }
  kernel::check_launch("the Adam step of the Gaussians");
}

}  // namespace jade::gaussians::cuda
