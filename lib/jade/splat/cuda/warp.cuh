// SPDX-License-Identifier: Apache-2.0
// Sums and scans across a warp.
#pragma once

#include <cstdint>

namespace jade::splat::cuda {

__device__ __forceinline__ float warp_sum(float value) {
  for (int step = 16; step > 0; step >>= 1) value += __shfl_xor_sync(~0u, value, step);
  return value;
}

__device__ __forceinline__ uint32_t inclusive_scan(uint32_t value, int lane) {
  for (int step = 1; step < 32; step *= 2) {
    const uint32_t other = __shfl_up_sync(~0u, value, step);
    if (lane >= step) value += other;
  }
  return value;
}

/// Items of all lanes in one sequence, for even distribution: lane k's begin at item `begin`.
struct Shares {
  uint32_t begin, total;

  __device__ __forceinline__ Shares(uint32_t count, int lane) {
    const uint32_t scanned = inclusive_scan(count, lane);
    begin = scanned - count;
    total = __shfl_sync(~0u, scanned, 31);
  }
  /// The lane that owns item i; any lane for items beyond the last.
  __device__ __forceinline__ int owner(uint32_t i) const {
    // the last that begins at or before i: earlier ones with the same begin are empty
    int lane = 0;
    for (int step = 16; step > 0; step /= 2) {
      if (__shfl_sync(~0u, begin, lane + step) <= i) lane += step;
    }
    return lane;
  }
};

/// One halving step of a sum by lanes: lanes with `bit` set keep the upper half of the values.
template <int kHalf>
__device__ __forceinline__ void exchange_halves(float* values, int bit, bool upper) {
#pragma unroll
  for (int k = 0; k < kHalf; ++k) {
    const float sent = upper ? values[k] : values[k + kHalf];
    const float kept = upper ? values[k + kHalf] : values[k];
    values[k] = kept + __shfl_xor_sync(~0u, sent, bit);
  }
}

/// Sums sixteen values over the warp with only sixteen shuffles. Lanes 2 k and 2 k + 1 get the sum
/// of values[k].
__device__ __forceinline__ float sum_sixteen(float* values, int lane) {
  exchange_halves<8>(values, 16, lane & 16);
  exchange_halves<4>(values, 8, lane & 8);
  exchange_halves<2>(values, 4, lane & 4);
  exchange_halves<1>(values, 2, lane & 2);
  float sum = values[0];
  sum += __shfl_xor_sync(~0u, sum, 1);
  return sum;
}

}  // namespace jade::splat::cuda
