// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <ATen/ops/empty_like.h>
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
struct Taps {
  float w[kSsimTaps];
};

/// An SsimPair as the kernels see it.
struct PairJob {
  const float* a;
  const float* b;
  const float* mean_b;
  const float* square_b;
  float* maps;  ///< [3 or 4, planes, H, W] when a gradient is wanted: ∂μa, ∂E[a²], ∂E[ab], ∂μb
  float* grad_a;
  float* grad_b;
  float weight_ssim, weight_l1;  ///< over the number of values
  int planes, first_plane, term;
  bool maps_of_b;  ///< the fourth map is there
};

/// An SsimTerm.
struct TermJob {
  int first_pair, pairs;
  float weight;
  const float* scale;
};

/// An SsimBatch.
struct Job {
  PairJob pairs[kMostPairs];
  TermJob terms[kMostPairs];
  int pair_count, term_count;
  int height, width;
  double offset;
  double* partial;  ///< [blocks, 2], the blocks of a plane one after another
  float* total;
  float* values;  ///< [T]
  const float* of_total;
  const float* of_values;
};

struct Tile {
  int x0, y0, width, height;
  int pair;
  int64_t plane;  ///< index of the plane's first pixel among those of its pair
};

__device__ Tile this_tile(const Job& in) {
  const int plane = static_cast<int>(blockIdx.z);
  int pair = 0;
  while (pair + 1 < in.pair_count && plane >= in.pairs[pair + 1].first_plane) ++pair;
  return {static_cast<int>(blockIdx.x) * kTileWidth,
          static_cast<int>(blockIdx.y) * kTileHeight,
          in.width,
          in.height,
          pair,
          static_cast<int64_t>(plane - in.pairs[pair].first_plane) * in.width * in.height};
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

/// SSIM at every pixel of a tile, its sum, and the derivative maps.
__global__ void __launch_bounds__(kThreads) ssim_forward(Job in, Taps taps) {
  __shared__ float a[kHaloHeight][kHaloWidth], b[kHaloHeight][kHaloWidth];
  __shared__ float filtered[5][kHaloHeight][kTileWidth];
  const Tile tile = this_tile(in);
  const PairJob& pair = in.pairs[tile.pair];
  const bool fixed = pair.mean_b != nullptr;
  load_halo(pair.a + tile.plane, tile, a);
  load_halo(pair.b + tile.plane, tile, b);
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
      if (fixed) continue;
      sums[3] += w * vb;
      sums[4] += w * vb * vb;
    }
#pragma unroll
    for (int q = 0; q < 5; ++q) {
      if (q < 3 || !fixed) filtered[q][row][column] = sums[q];
    }
  }
  __syncthreads();
  const int column = threadIdx.x % kTileWidth, x = tile.x0 + column;
  const int64_t map_size = static_cast<int64_t>(pair.planes) * in.height * in.width;
  double ssim_sum = 0, l1_sum = 0;
  for (int row = threadIdx.x / kTileWidth; row < kTileHeight; row += kRowsPerPass) {
    const int y = tile.y0 + row;
    if (x >= tile.width || y >= tile.height) continue;
    const int64_t pixel = tile.plane + static_cast<int64_t>(y) * tile.width + x;
    SsimMoments<float> moments;
    moments.a = filter_down(filtered[0], row, column, taps);
    moments.aa = filter_down(filtered[1], row, column, taps);
    moments.ab = filter_down(filtered[2], row, column, taps);
    if (fixed) {
      moments.b = pair.mean_b[pixel];
      moments.bb = pair.square_b[pixel];
    } else {
      moments.b = filter_down(filtered[3], row, column, taps);
      moments.bb = filter_down(filtered[4], row, column, taps);
    }
    const SsimTerms<float> terms = ssim_terms(moments);
    ssim_sum += terms.value;
    l1_sum += fabsf(a[row + kSsimRadius][column + kSsimRadius] -
                    b[row + kSsimRadius][column + kSsimRadius]);
    if (pair.maps == nullptr) continue;
    const SsimDerivatives<float> d = ssim_derivatives(moments, terms);
    pair.maps[pixel] = d.a;
    pair.maps[map_size + pixel] = d.square;
    pair.maps[2 * map_size + pixel] = d.ab;
    if (pair.maps_of_b) pair.maps[3 * map_size + pixel] = d.b;
  }
  sum_block(ssim_sum, l1_sum);
  if (threadIdx.x == 0) {
    const int64_t block =
        (static_cast<int64_t>(blockIdx.z) * gridDim.y + blockIdx.y) * gridDim.x + blockIdx.x;
    in.partial[2 * block] = ssim_sum;
    in.partial[2 * block + 1] = l1_sum;
  }
}

/// The gradient of a pair's value before its division by the number of values.
__device__ float upstream_of(const Job& in, const PairJob& pair) {
  const TermJob& term = in.terms[pair.term];
  float factor = 0;
  if (in.of_total != nullptr) factor += *in.of_total;
  if (in.of_values != nullptr) factor += in.of_values[pair.term];
  return factor * term.weight * (term.scale == nullptr ? 1.0f : *term.scale);
}

/// Filters the derivative maps and joins them to the gradients.
__global__ void __launch_bounds__(kThreads) ssim_backward(Job in, Taps taps) {
  __shared__ float halo[kHaloHeight][kHaloWidth];
  __shared__ float filtered[4][kHaloHeight][kTileWidth];
  const Tile tile = this_tile(in);
  const PairJob& pair = in.pairs[tile.pair];
  if (pair.grad_a == nullptr && pair.grad_b == nullptr) return;
  const int64_t map_size = static_cast<int64_t>(pair.planes) * in.height * in.width;
  const int maps = pair.grad_b != nullptr ? 4 : 3;
  for (int q = 0; q < maps; ++q) {
    __syncthreads();  // the halo of the map before has been read
    load_halo(pair.maps + q * map_size + tile.plane, tile, halo);
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
  const float upstream = upstream_of(in, pair);
  const float weight_ssim = upstream * pair.weight_ssim, weight_l1 = upstream * pair.weight_l1;
  const int column = threadIdx.x % kTileWidth, x = tile.x0 + column;
  for (int row = threadIdx.x / kTileWidth; row < kTileHeight; row += kRowsPerPass) {
    const int y = tile.y0 + row;
    if (x >= tile.width || y >= tile.height) continue;
    const int64_t pixel = tile.plane + static_cast<int64_t>(y) * tile.width + x;
    const float a = pair.a[pixel], b = pair.b[pixel];
    const float sign = weight_l1 * l1_gradient(a, b);
    const float d_sq = filter_down(filtered[1], row, column, taps);
    const float d_ab = filter_down(filtered[2], row, column, taps);
    if (pair.grad_a != nullptr) {
      const float d_ma = filter_down(filtered[0], row, column, taps);
      pair.grad_a[pixel] = weight_ssim * ssim_gradient(d_ma, d_sq, d_ab, a, b) + sign;
    }
    if (pair.grad_b != nullptr) {
      const float d_mb = filter_down(filtered[3], row, column, taps);
      pair.grad_b[pixel] = weight_ssim * ssim_gradient(d_mb, d_sq, d_ab, b, a) - sign;
    }
  }
}

/// A warp per pair adds its blocks' sums in a fixed order: the value does not change from run to
/// run. Then one thread weighs the terms.
__global__ void ssim_finish(Job in, int64_t blocks_per_plane) {
  __shared__ float values[kMostPairs];
  const int index = threadIdx.x / 32, lane = threadIdx.x % 32;
  const PairJob& pair = in.pairs[index];
  const double2* const sums = reinterpret_cast<const double2*>(in.partial);
  const int64_t begin = pair.first_plane * blocks_per_plane;
  const int64_t end = begin + pair.planes * blocks_per_plane;
  double ssim_sum = 0, l1_sum = 0;
#pragma unroll 4
  for (int64_t block = begin + lane; block < end; block += 32) {
    const double2 both = sums[block];
    ssim_sum += both.x;
    l1_sum += both.y;
  }
  for (int offset = 16; offset > 0; offset /= 2) {
    ssim_sum += __shfl_down_sync(0xffffffffu, ssim_sum, offset);
    l1_sum += __shfl_down_sync(0xffffffffu, l1_sum, offset);
  }
  if (lane == 0) {
    values[index] = static_cast<float>(in.offset + double(pair.weight_ssim) * ssim_sum +
                                       double(pair.weight_l1) * l1_sum);
  }
  __syncthreads();
  if (threadIdx.x != 0) return;
  float total = 0;
  for (int t = 0; t < in.term_count; ++t) {
    const TermJob& term = in.terms[t];
    float sum = 0;
    for (int i = 0; i < term.pairs; ++i) sum += values[term.first_pair + i];
    in.values[t] = sum * term.weight * (term.scale == nullptr ? 1.0f : *term.scale);
    total += in.values[t];
  }
  *in.total = total;
}

Taps make_taps() {
  Taps taps{};
  for (int k = 0; k < kSsimTaps; ++k) taps.w[k] = static_cast<float>(ssim_window()[k]);
  return taps;
}

/// One block per tile of each plane.
dim3 grid_of(const Job& job) {
  const PairJob& last = job.pairs[job.pair_count - 1];
  return {kernel::grid_size(job.width, kTileWidth), kernel::grid_size(job.height, kTileHeight),
          static_cast<unsigned>(last.first_plane + last.planes)};
}

int map_count(const SsimPair& pair) { return pair.grad_b ? 4 : pair.grad_a ? 3 : 0; }

/// The batch without outputs and working memory.
Job job_of(const SsimBatch& batch) {
  if (batch.pairs.size() > kMostPairs) {
    throw DeviceError(concat("SSIM on a GPU takes at most ", kMostPairs,
                             " pairs of images at once, found ", batch.pairs.size()));
  }
  Job job{};
  int64_t planes = 0;
  for (const SsimPair& pair : batch.pairs) {
    const ImagePlanes size = planes_of(pair.a);
    job.height = static_cast<int>(size.height);
    job.width = static_cast<int>(size.width);
    PairJob& to = job.pairs[job.pair_count++];
    to.a = pair.a.const_data_ptr<float>();
    to.b = pair.b.const_data_ptr<float>();
    to.mean_b = read_or_null<float>(pair.mean_b);
    to.square_b = read_or_null<float>(pair.square_b);
    to.weight_ssim = static_cast<float>(batch.weights.ssim / static_cast<double>(pair.a.numel()));
    to.weight_l1 = static_cast<float>(batch.weights.l1 / static_cast<double>(pair.a.numel()));
    to.planes = static_cast<int>(size.count);
    to.first_plane = static_cast<int>(planes);
    planes += size.count;
  }
  if (planes > 65535 || job.height > 65535 * kTileHeight) {
    throw DeviceError(concat("SSIM on a GPU takes at most 65535 image planes, found ", planes));
  }
  int pair = 0;
  for (const SsimTerm& term : batch.terms) {
    TermJob& to = job.terms[job.term_count];
    to = {pair, static_cast<int>(term.pairs), static_cast<float>(term.weight),
          read_or_null<float>(term.scale)};
    for (int i = 0; i < to.pairs; ++i) job.pairs[pair++].term = job.term_count;
    ++job.term_count;
  }
  job.offset = batch.weights.offset;
  return job;
}

/// Where each pair's maps lie in one buffer, none where no gradient is wanted.
void set_maps(const SsimBatch& batch, const at::Tensor& maps, Job* job) {
  float* next = write_or_null<float>(maps);
  for (size_t i = 0; i < batch.pairs.size(); ++i) {
    const SsimPair& pair = batch.pairs[i];
    if (map_count(pair) == 0) continue;
    job->pairs[i].maps = next;
    job->pairs[i].maps_of_b = pair.grad_b;
    next += map_count(pair) * pair.a.numel();
  }
}

}  // namespace

SsimValues similarity(const SsimBatch& batch) {
  const c10::cuda::CUDAGuard guard(batch.pairs[0].a.device());
  const auto stream = c10::cuda::getCurrentCUDAStream();
  const auto options = batch.pairs[0].a.options().requires_grad(false);
  Job job = job_of(batch);
  const dim3 grid = grid_of(job);
  const int64_t blocks_per_plane = int64_t{grid.x} * grid.y;
  SsimValues out{at::empty({}, options), at::empty({job.term_count}, options), {at::Tensor()}};
  const at::Tensor partial = at::empty({blocks_per_plane * grid.z, 2}, options.dtype(at::kDouble));
  if (batch.any_gradient()) {
    int64_t count = 0;
    for (const SsimPair& pair : batch.pairs) count += map_count(pair) * pair.a.numel();
    out.kept[0] = at::empty({count}, options);
    set_maps(batch, out.kept[0], &job);
  }
  job.partial = partial.mutable_data_ptr<double>();
  job.total = out.total.mutable_data_ptr<float>();
  job.values = out.terms.mutable_data_ptr<float>();
  ssim_forward<<<grid, kThreads, 0, stream>>>(job, make_taps());
  kernel::check_launch("SSIM");
  ssim_finish<<<1, 32 * job.pair_count, 0, stream>>>(job, blocks_per_plane);
  kernel::check_launch("SSIM, sum");
  return out;
}

std::vector<at::Tensor> similarity_gradients(const SsimBatch& batch,
                                             const std::vector<at::Tensor>& kept,
                                             const SsimUpstream& upstream) {
  std::vector<at::Tensor> result(2 * batch.pairs.size());
  if (!batch.any_gradient()) return result;
  const c10::cuda::CUDAGuard guard(batch.pairs[0].a.device());
  Job job = job_of(batch);
  set_maps(batch, kept[0], &job);
  const at::Tensor of_terms =
      upstream.terms.defined() ? upstream.terms.contiguous() : upstream.terms;
  job.of_total = read_or_null<float>(upstream.total);
  job.of_values = read_or_null<float>(of_terms);
  for (size_t i = 0; i < batch.pairs.size(); ++i) {
    const SsimPair& pair = batch.pairs[i];
    if (pair.grad_a) result[2 * i] = at::empty_like(pair.a);
    if (pair.grad_b) result[2 * i + 1] = at::empty_like(pair.b);
    job.pairs[i].grad_a = write_or_null<float>(result[2 * i]);
    job.pairs[i].grad_b = write_or_null<float>(result[2 * i + 1]);
  }
  ssim_backward<<<grid_of(job), kThreads, 0, c10::cuda::getCurrentCUDAStream()>>>(job, make_taps());
  kernel::check_launch("SSIM, backward");
  return result;
}

}  // namespace jade::imaging::cuda
