// SPDX-License-Identifier: Apache-2.0
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/core/error.h"
#include "jade/imaging/ssim_kernels.h"
#include "jade/kernel/launch.h"

namespace jade::imaging {
namespace {

constexpr int kTileWidth = 32, kTileHeight = 16, kRowsPerPass = 8;
constexpr int kThreads = kTileWidth * kRowsPerPass;
constexpr int kHaloWidth = kTileWidth + 2 * kSsimRadius,
              kHaloHeight = kTileHeight + 2 * kSsimRadius;
constexpr int kSumThreads = 256;

struct Taps {
  float w[kSsimTaps];
};

struct Tile {
  int x0, y0, width, height;
  int64_t plane;  ///< index of the plane's first pixel
};

__device__ Tile this_tile(const SsimCuda& in) {
  const int width = static_cast<int>(in.width), height = static_cast<int>(in.height);
  return {static_cast<int>(blockIdx.x) * kTileWidth, static_cast<int>(blockIdx.y) * kTileHeight,
          width, height, static_cast<int64_t>(blockIdx.z) * width * height};
}

/// The tile with 5 pixels around it; zeros beside the image.
__device__ void load_halo(const float* plane, const Tile& tile,
                          float (&out)[kHaloHeight][kHaloWidth]) {
  for (int i = threadIdx.x; i < kHaloHeight * kHaloWidth; i += kThreads) {
    const int row = i / kHaloWidth, column = i % kHaloWidth;
    const int y = tile.y0 + row - kSsimRadius, x = tile.x0 + column - kSsimRadius;
    const bool inside = x >= 0 && x < tile.width && y >= 0 && y < tile.height;
    out[row][column] = inside ? plane[static_cast<int64_t>(y) * tile.width + x] : 0.0f;
  }
}

__device__ float filter_down(const float (&rows)[kHaloHeight][kTileWidth], int row, int column,
                             const Taps& taps) {
  float sum = 0;
#pragma unroll
  for (int k = 0; k < kSsimTaps; ++k) sum += taps.w[k] * rows[row + k][column];
  return sum;
}

/// Sums two values over the block; thread 0 holds the result.
__device__ void sum_block(double& first, double& second) {
  __shared__ double sums[2][kThreads / 32];
  for (int offset = 16; offset > 0; offset /= 2) {
    first += __shfl_down_sync(0xffffffffu, first, offset);
    second += __shfl_down_sync(0xffffffffu, second, offset);
  }
  if (threadIdx.x % 32 == 0) {
    sums[0][threadIdx.x / 32] = first;
    sums[1][threadIdx.x / 32] = second;
  }
  __syncthreads();
  if (threadIdx.x == 0) {
    first = second = 0;
    for (int warp = 0; warp < kThreads / 32; ++warp) {
      first += sums[0][warp];
      second += sums[1][warp];
    }
  }
}

/// SSIM at every pixel of a tile, its sum, and the derivative maps ∂μa, ∂E[a²], ∂E[ab], ∂μb.
template <bool kFixedTarget>
__global__ void __launch_bounds__(kThreads) ssim_forward(SsimCuda in, Taps taps) {
  __shared__ float a[kHaloHeight][kHaloWidth], b[kHaloHeight][kHaloWidth];
  constexpr int kFiltered = kFixedTarget ? 3 : 5;
  __shared__ float filtered[kFiltered][kHaloHeight][kTileWidth];
  const Tile tile = this_tile(in);
  load_halo(in.a + tile.plane, tile, a);
  load_halo(in.b + tile.plane, tile, b);
  __syncthreads();
  for (int i = threadIdx.x; i < kHaloHeight * kTileWidth; i += kThreads) {
    const int row = i / kTileWidth, column = i % kTileWidth;
    float sums[5] = {};
#pragma unroll
    for (int k = 0; k < kSsimTaps; ++k) {
      const float va = a[row][column + k], vb = b[row][column + k], w = taps.w[k];
      sums[0] += w * va;
      sums[1] += w * va * va;
      sums[2] += w * va * vb;
      sums[3] += w * vb;
      sums[4] += w * vb * vb;
    }
#pragma unroll
    for (int q = 0; q < kFiltered; ++q) filtered[q][row][column] = sums[q];
  }
  __syncthreads();
  const int column = threadIdx.x % kTileWidth, x = tile.x0 + column;
  const int64_t map_size = in.planes * in.height * in.width;
  double ssim_sum = 0, l1_sum = 0;
  for (int row = threadIdx.x / kTileWidth; row < kTileHeight; row += kRowsPerPass) {
    const int y = tile.y0 + row;
    if (x >= tile.width || y >= tile.height) continue;
    const int64_t pixel = tile.plane + static_cast<int64_t>(y) * tile.width + x;
    const float ma = filter_down(filtered[0], row, column, taps);
    const float eaa = filter_down(filtered[1], row, column, taps);
    const float eab = filter_down(filtered[2], row, column, taps);
    float mb, ebb;
    if constexpr (kFixedTarget) {
      mb = in.mean_b[pixel];
      ebb = in.square_b[pixel];
    } else {
      mb = filter_down(filtered[3], row, column, taps);
      ebb = filter_down(filtered[4], row, column, taps);
    }
    const float mm = ma * mb, aa = ma * ma, bb = mb * mb;
    const float a1 = 2 * mm + float(kSsimC1), a2 = 2 * (eab - mm) + float(kSsimC2);
    const float b1 = aa + bb + float(kSsimC1), b2 = (eaa - aa) + (ebb - bb) + float(kSsimC2);
    const float inverse = 1 / (b1 * b2), value = a1 * a2 * inverse;
    ssim_sum += value;
    l1_sum += fabsf(a[row + kSsimRadius][column + kSsimRadius] -
                    b[row + kSsimRadius][column + kSsimRadius]);
    if (in.maps == nullptr) continue;
    const float cross = 2 * (a2 - a1) * inverse, own = 2 * value * (b2 - b1) * inverse;
    in.maps[pixel] = cross * mb - own * ma;
    in.maps[map_size + pixel] = -value * b1 * inverse;
    in.maps[2 * map_size + pixel] = 2 * a1 * inverse;
    if (in.grad_b != nullptr) in.maps[3 * map_size + pixel] = cross * ma - own * mb;
  }
  sum_block(ssim_sum, l1_sum);
  if (threadIdx.x == 0) {
    const int64_t block =
        (static_cast<int64_t>(blockIdx.z) * gridDim.y + blockIdx.y) * gridDim.x + blockIdx.x;
    in.partial[2 * block] = ssim_sum;
    in.partial[2 * block + 1] = l1_sum;
  }
}

/// Filters the derivative maps and joins them to the gradients.
template <int kMaps>
__global__ void __launch_bounds__(kThreads) ssim_backward(SsimCuda in, Taps taps) {
  __shared__ float halo[kHaloHeight][kHaloWidth];
  __shared__ float filtered[kMaps][kHaloHeight][kTileWidth];
  const Tile tile = this_tile(in);
  const int64_t map_size = in.planes * in.height * in.width;
  for (int q = 0; q < kMaps; ++q) {
    __syncthreads();  // the halo of the map before has been read
    load_halo(in.maps + q * map_size + tile.plane, tile, halo);
    __syncthreads();
    for (int i = threadIdx.x; i < kHaloHeight * kTileWidth; i += kThreads) {
      const int row = i / kTileWidth, column = i % kTileWidth;
      float sum = 0;
#pragma unroll
      for (int k = 0; k < kSsimTaps; ++k) sum += taps.w[k] * halo[row][column + k];
      filtered[q][row][column] = sum;
    }
  }
  __syncthreads();
  const int column = threadIdx.x % kTileWidth, x = tile.x0 + column;
  for (int row = threadIdx.x / kTileWidth; row < kTileHeight; row += kRowsPerPass) {
    const int y = tile.y0 + row;
    if (x >= tile.width || y >= tile.height) continue;
    const int64_t pixel = tile.plane + static_cast<int64_t>(y) * tile.width + x;
    const float a = in.a[pixel], b = in.b[pixel];
    const float sign = in.weight_l1 * (float(a > b) - float(a < b));
    const float d_sq = filter_down(filtered[1], row, column, taps);
    const float d_ab = filter_down(filtered[2], row, column, taps);
    if (in.grad_a != nullptr) {
      const float d_ma = filter_down(filtered[0], row, column, taps);
      in.grad_a[pixel] = in.weight_ssim * (d_ma + 2 * a * d_sq + b * d_ab) + sign;
    }
    if constexpr (kMaps == 4) {
      const float d_mb = filter_down(filtered[3], row, column, taps);
      in.grad_b[pixel] = in.weight_ssim * (d_mb + 2 * b * d_sq + a * d_ab) - sign;
    }
  }
}

/// Adds the blocks' sums in a fixed order: the value does not change from run to run.
__global__ void __launch_bounds__(kSumThreads) ssim_finish(SsimCuda in, int64_t blocks) {
  __shared__ double sums[2][kSumThreads];
  double ssim_sum = 0, l1_sum = 0;
  for (int64_t block = threadIdx.x; block < blocks; block += kSumThreads) {
    ssim_sum += in.partial[2 * block];
    l1_sum += in.partial[2 * block + 1];
  }
  sums[0][threadIdx.x] = ssim_sum;
  sums[1][threadIdx.x] = l1_sum;
  for (int half = kSumThreads / 2; half > 0; half /= 2) {
    __syncthreads();
    if (threadIdx.x < half) {
      sums[0][threadIdx.x] += sums[0][threadIdx.x + half];
      sums[1][threadIdx.x] += sums[1][threadIdx.x + half];
    }
  }
  if (threadIdx.x == 0) {
    *in.value = static_cast<float>(in.offset + double(in.weight_ssim) * sums[0][0] +
                                   double(in.weight_l1) * sums[1][0]);
  }
}

}  // namespace

int64_t ssim_cuda_blocks(int64_t planes, int64_t height, int64_t width) {
  return planes * ((height + kTileHeight - 1) / kTileHeight) *
         ((width + kTileWidth - 1) / kTileWidth);
}

void ssim_cuda(const SsimCuda& arguments, const double* window, int device_index) {
  const c10::cuda::CUDAGuard guard(static_cast<c10::DeviceIndex>(device_index));
  const cudaStream_t stream =
      c10::cuda::getCurrentCUDAStream(static_cast<c10::DeviceIndex>(device_index)).stream();
  if (arguments.planes > 65535 || arguments.height > 65535 * kTileHeight) {
    throw DeviceError(
        concat("SSIM on a GPU takes at most 65535 image planes, found ", arguments.planes));
  }
  Taps taps{};
  for (int k = 0; k < kSsimTaps; ++k) taps.w[k] = static_cast<float>(window[k]);
  const dim3 grid(static_cast<unsigned>((arguments.width + kTileWidth - 1) / kTileWidth),
                  static_cast<unsigned>((arguments.height + kTileHeight - 1) / kTileHeight),
                  static_cast<unsigned>(arguments.planes));
  if (arguments.mean_b != nullptr) {
    ssim_forward<true><<<grid, kThreads, 0, stream>>>(arguments, taps);
  } else {
    ssim_forward<false><<<grid, kThreads, 0, stream>>>(arguments, taps);
  }
  kernel::check_launch("SSIM");
  if (arguments.grad_b != nullptr) {
    ssim_backward<4><<<grid, kThreads, 0, stream>>>(arguments, taps);
    kernel::check_launch("SSIM, backward");
  } else if (arguments.grad_a != nullptr) {
    ssim_backward<3><<<grid, kThreads, 0, stream>>>(arguments, taps);
    kernel::check_launch("SSIM, backward");
  }
  const int64_t blocks = ssim_cuda_blocks(arguments.planes, arguments.height, arguments.width);
  ssim_finish<<<1, kSumThreads, 0, stream>>>(arguments, blocks);
  kernel::check_launch("SSIM, sum");
}

}  // namespace jade::imaging
