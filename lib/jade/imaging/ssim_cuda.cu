// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/core/error.h"
#include "jade/imaging/ssim_kernels.h"
#include "jade/imaging/ssim_math.h"
#include "jade/kernel/launch.h"

namespace jade::imaging::cuda {
namespace {

constexpr int kTileWidth = 32, kTileHeight = 16, kRowsPerPass = 8;
constexpr int kThreads = kTileWidth * kRowsPerPass;
constexpr int kHaloWidth = kTileWidth + 2 * kSsimRadius,
              kHaloHeight = kTileHeight + 2 * kSsimRadius;
constexpr int kSumThreads = 256;

struct Taps {
  float w[kSsimTaps];
};

/// SsimArguments as the kernels see them.
struct Job {
  const float* a;
  const float* b;
  const float* mean_b;
  const float* square_b;
  int64_t planes, height, width;
  float weight_ssim, weight_l1;
  double offset;
  float* maps;  ///< [4 or 3, planes, H, W] when a gradient is wanted
  float* grad_a;
  float* grad_b;
  double* partial;  ///< [blocks, 2]
  float* value;     ///< offset + weight_ssim Σ S + weight_l1 Σ |a − b|
};

struct Tile {
  int x0, y0, width, height;
  int64_t plane;  ///< index of the plane's first pixel
};

__device__ Tile this_tile(const Job& in) {
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
__global__ void __launch_bounds__(kThreads) ssim_forward(Job in, Taps taps) {
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
    SsimMoments<float> moments;
    moments.a = filter_down(filtered[0], row, column, taps);
    moments.aa = filter_down(filtered[1], row, column, taps);
    moments.ab = filter_down(filtered[2], row, column, taps);
    if constexpr (kFixedTarget) {
      moments.b = in.mean_b[pixel];
      moments.bb = in.square_b[pixel];
    } else {
      moments.b = filter_down(filtered[3], row, column, taps);
      moments.bb = filter_down(filtered[4], row, column, taps);
    }
    const SsimTerms<float> terms = ssim_terms(moments);
    ssim_sum += terms.value;
    l1_sum += fabsf(a[row + kSsimRadius][column + kSsimRadius] -
                    b[row + kSsimRadius][column + kSsimRadius]);
    if (in.maps == nullptr) continue;
    const SsimDerivatives<float> d = ssim_derivatives(moments, terms);
    in.maps[pixel] = d.a;
    in.maps[map_size + pixel] = d.square;
    in.maps[2 * map_size + pixel] = d.ab;
    if (in.grad_b != nullptr) in.maps[3 * map_size + pixel] = d.b;
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
__global__ void __launch_bounds__(kThreads) ssim_backward(Job in, Taps taps) {
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
    const float sign = in.weight_l1 * l1_gradient(a, b);
    const float d_sq = filter_down(filtered[1], row, column, taps);
    const float d_ab = filter_down(filtered[2], row, column, taps);
    if (in.grad_a != nullptr) {
      const float d_ma = filter_down(filtered[0], row, column, taps);
      in.grad_a[pixel] = in.weight_ssim * ssim_gradient(d_ma, d_sq, d_ab, a, b) + sign;
    }
    if constexpr (kMaps == 4) {
      const float d_mb = filter_down(filtered[3], row, column, taps);
      in.grad_b[pixel] = in.weight_ssim * ssim_gradient(d_mb, d_sq, d_ab, b, a) - sign;
    }
  }
}

/// Adds the blocks' sums in a fixed order: the value does not change from run to run.
__global__ void __launch_bounds__(kSumThreads) ssim_finish(Job in, int64_t blocks) {
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

Taps make_taps() {
  Taps taps{};
  for (int k = 0; k < kSsimTaps; ++k) taps.w[k] = static_cast<float>(ssim_window()[k]);
  return taps;
}

/// @param grid  one block per tile of each plane
void launch(const Job& job, dim3 grid, cudaStream_t stream) {
  const Taps taps = make_taps();
  if (job.mean_b != nullptr) {
    ssim_forward<true><<<grid, kThreads, 0, stream>>>(job, taps);
  } else {
    ssim_forward<false><<<grid, kThreads, 0, stream>>>(job, taps);
  }
  kernel::check_launch("SSIM");
  if (job.grad_b != nullptr) {
    ssim_backward<4><<<grid, kThreads, 0, stream>>>(job, taps);
  } else if (job.grad_a != nullptr) {
    ssim_backward<3><<<grid, kThreads, 0, stream>>>(job, taps);
  }
  kernel::check_launch("SSIM, backward");
  ssim_finish<<<1, kSumThreads, 0, stream>>>(job, int64_t{grid.x} * grid.y * grid.z);
  kernel::check_launch("SSIM, sum");
}

}  // namespace

at::Tensor similarity(const SsimArguments& arguments) {
  const at::Tensor& a = arguments.a;
  const ImagePlanes planes = planes_of(a);
  if (planes.count > 65535 || planes.height > 65535 * kTileHeight) {
    throw DeviceError(
        concat("SSIM on a GPU takes at most 65535 image planes, found ", planes.count));
  }
  const c10::cuda::CUDAGuard guard(a.device());
  const dim3 grid(kernel::grid_size(planes.width, kTileWidth),
                  kernel::grid_size(planes.height, kTileHeight),
                  static_cast<unsigned>(planes.count));
  const auto options = a.options().requires_grad(false);
  at::Tensor value = at::empty({}, options);
  const at::Tensor partial =
      at::empty({int64_t{grid.x} * grid.y * grid.z, 2}, options.dtype(at::kDouble));
  at::Tensor maps;
  if (arguments.grad_a.defined() || arguments.grad_b.defined()) {
    maps = at::empty({arguments.grad_b.defined() ? 4 : 3, a.numel()}, options);
  }
  Job job{};
  job.a = a.const_data_ptr<float>();
  job.b = arguments.b.const_data_ptr<float>();
  job.mean_b = read_or_null<float>(arguments.mean_b);
  job.square_b = read_or_null<float>(arguments.square_b);
  job.planes = planes.count;
  job.height = planes.height;
  job.width = planes.width;
  job.weight_ssim = static_cast<float>(arguments.weights.ssim / static_cast<double>(a.numel()));
  job.weight_l1 = static_cast<float>(arguments.weights.l1 / static_cast<double>(a.numel()));
  job.offset = arguments.weights.offset;
  job.maps = write_or_null<float>(maps);
  job.grad_a = write_or_null<float>(arguments.grad_a);
  job.grad_b = write_or_null<float>(arguments.grad_b);
  job.partial = partial.mutable_data_ptr<double>();
  job.value = value.mutable_data_ptr<float>();
  launch(job, grid, c10::cuda::getCurrentCUDAStream(a.device().index()));
  return value;
}

}  // namespace jade::imaging::cuda
