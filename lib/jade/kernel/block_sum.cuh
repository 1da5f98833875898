// SPDX-License-Identifier: Apache-2.0
// Sums over the threads of a warp or a block, always in the same order.
#pragma once

namespace jade::kernel {

/// Sums each value over the warp; lane 0 receives the results. All 32 lanes must call it.
template <class T, int kCount>
__device__ __forceinline__ void warp_sum(T (&values)[kCount]) {
  for (int offset = 16; offset > 0; offset /= 2) {
    for (int k = 0; k < kCount; ++k) values[k] += __shfl_down_sync(~0u, values[k], offset);
  }
}

/// Sums each value over a block of kThreads, a multiple of 32: within a warp in T, across warps in
/// double. Thread 0 receives the results. All threads must call it, at most once per kernel.
template <int kThreads, class T, int kCount>
static __device__ __forceinline__ void block_sum(T (&values)[kCount], double (&sums)[kCount]) {
  static_assert(kThreads % 32 == 0, "whole warps");
  __shared__ T of_warp[kThreads / 32][kCount];
  warp_sum(values);
  for (int k = 0; k < kCount; ++k) {
    if (threadIdx.x % 32 == 0) of_warp[threadIdx.x / 32][k] = values[k];
    sums[k] = 0;
  }
  __syncthreads();
  if (threadIdx.x != 0) return;
  for (int warp = 0; warp < kThreads / 32; ++warp) {
    for (int k = 0; k < kCount; ++k) sums[k] += of_warp[warp][k];
  }
}

}  // namespace jade::kernel
