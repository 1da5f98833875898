// SPDX-License-Identifier: Apache-2.0
// Inputs of the router's kernels: pixels of an image or of a gradient, in half precision for the
// tensor cores.
//
// Half precision has the 11 bits of TF32, but a smaller exponent. So a tile is first multiplied by
// the power of two that scales its largest number to 2^14; only numbers 2^28 times smaller lose
// bits.
#pragma once

#include "jade/kernel/host_device.h"
#include "jade/kernel/tensor_core.cuh"

namespace jade::router::cuda {

constexpr int kTileX = 32, kTileY = 8;
constexpr int kInputPlanes = 5;  ///< planes of X_in

JADE_HD constexpr int round_up(int value, int step) { return (value + step - 1) / step * step; }

/// A power of two and its inverse, both normal numbers.
struct Scale {
  float factor, inverse;
  /// Scales this non-negative number to [2^14, 2^15).
  __device__ explicit Scale(float largest) {
    const uint32_t exponent = min(268u - (__float_as_uint(largest) >> 23), 227u);
    factor = __uint_as_float(exponent << 23);
    inverse = __uint_as_float((254u - exponent) << 23);
  }
};

/// The largest of the block's non-negative numbers. Contains a barrier; `slots` (one per warp) may
/// be reused after another one.
template <int THREADS>
__device__ float block_largest(float mine, uint32_t* slots) {
  // non-negative floats compare like integers
  const uint32_t of_warp = __reduce_max_sync(~0u, __float_as_uint(mine));
  if (threadIdx.x % 32 == 0) slots[threadIdx.x / 32] = of_warp;
  __syncthreads();
  uint32_t largest = slots[0];
#pragma unroll
  for (int warp = 1; warp < THREADS / 32; ++warp) largest = max(largest, slots[warp]);
  return __uint_as_float(largest);
}

/// Maximum over finite values, so that a NaN affects only its own products.
template <int COUNT>
__device__ __forceinline__ float largest_of(const float (&values)[COUNT]) {
  float largest = 0;
#pragma unroll
  for (int i = 0; i < COUNT; ++i) largest = fmaxf(largest, fabsf(values[i]));
  return largest;
}

/// Sources are read one pixel at a time, with all its channels.
struct Size {
  int height, width;

  JADE_HD int64_t plane() const { return int64_t{height} * width; }
  __device__ int nearest(int y, int x) const {
    return min(max(y, 0), height - 1) * width + min(max(x, 0), width - 1);
  }
  __device__ bool has(int y, int x) const { return y >= 0 && y < height && x >= 0 && x < width; }
};

/// A layer's input with its edge replicated: the first FIRST channels from X_in, the rest from
/// another tensor.
template <int FIRST>
struct ImageSource {
  Size size;
  const float* rest;             ///< [N,channels,H,W]; may start at a later channel
  int channels;                  ///< of the tensor of `rest`
  const float* first = nullptr;  ///< [N,5,H,W]; needed for FIRST > 0

  template <int COUNT>
  __device__ __forceinline__ void read(int image, int y, int x, float (&values)[COUNT]) const {
    const int64_t plane = size.plane();
    const uint32_t offset = size.nearest(y, x);
    const float* const later = rest + image * channels * plane;
    const float* from = FIRST > 0 ? first + image * kInputPlanes * plane : later;
#pragma unroll
    for (int c = 0; c < COUNT; ++c) {
      if (c == FIRST) from = later;
      values[c] = __ldg(from + offset);
      from += plane;
    }
  }
};

/// The gradient of a layer's output, zero outside the image and, with RELU, where the output is not
/// positive.
template <bool RELU>
struct GradientSource {
  Size size;
  const float* of_out;  ///< [N,channels,H,W]
  const float* out;     ///< likewise
  int channels;         ///< of both tensors; the pointers may start at a later channel

  template <int COUNT>
  __device__ __forceinline__ void read(int image, int y, int x, float (&values)[COUNT]) const {
    const int64_t plane = size.plane(), begin = image * channels * plane;
    const uint32_t offset = size.nearest(y, x);
    const bool inside = size.has(y, x);
    const float *from = of_out + begin, *passed = out + begin;
#pragma unroll
    for (int c = 0; c < COUNT; ++c) {
      const float value = __ldg(from + offset);
      const bool held = RELU && __ldg(passed + offset) <= 0;
      values[c] = inside && !held ? value : 0.f;
      from += plane;
      passed += plane;
    }
  }
};

/// Source of head2's output gradient: the gradient of the logits times head3's weights.
struct HeadGradientSource {
  Size size;
  const float* of_logits;  ///< [N,1,H,W]
  const float* out;        ///< [N,COUNT,H,W]
  const float* weights;    ///< [COUNT]

  template <int COUNT>
  __device__ __forceinline__ void read(int image, int y, int x, float (&values)[COUNT]) const {
    const int64_t plane = size.plane();
    const uint32_t offset = size.nearest(y, x);
    const bool inside = size.has(y, x);
    const float value = __ldg(of_logits + image * plane + offset);
    const float* passed = out + image * COUNT * plane;
#pragma unroll
    for (int c = 0; c < COUNT; ++c) {
      const bool held = __ldg(passed + offset) <= 0;
      values[c] = inside && !held ? __ldg(weights + c) * value : 0.f;
      passed += plane;
    }
  }
};

}  // namespace jade::router::cuda
