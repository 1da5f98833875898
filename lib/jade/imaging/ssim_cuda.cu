// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <ATen/ops/empty_like.h>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/core/error.h"
#include "jade/imaging/ssim_kernels.h"
#include "jade/imaging/ssim_math.h"
#include "jade/kernel/block_sum.cuh"
#include "jade/kernel/launch.h"

namespace jade::imaging::cuda {
namespace {

constexpr int kTileWidth = 32, kTileHeight = 24;
constexpr int kThreads = 256, kWarps = kThreads / 32;
constexpr int kHaloWidth = kTileWidth + 2 * kSsimRadius,
              kHaloHeight = kTileHeight + 2 * kSsimRadius;
constexpr int kPitch = (kHaloWidth + 3) / 4 * 4;  ///< rows are multiples of float4
/// Results per thread, so that one value from shared memory serves several.
constexpr int kColumns = 4, kRows = kTileHeight / kWarps;
static_assert(kTileWidth == 32 && kTileHeight % kWarps == 0, "a lane per column, all rows taken");

struct Taps {
  float w[kSsimTaps];
};

/// An SsimPair for the kernels.
struct PairJob {
  const float* a;
  const float* b;
  const float* mean_b;
  const float* square_b;
  float* maps;  ///< [3 or 4, planes, H, W] if a gradient is required: ∂μa, ∂E[a²], ∂E[ab], ∂μb
  float* grad_a;
  float* grad_b;
  float weight_ssim, weight_l1;  ///< divided by the number of values
  int planes, first_plane, term;
  bool maps_of_b;  ///< whether there is a fourth map
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
  double* partial;  ///< [blocks, 2], blocks ordered by plane
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

/// A tile with a border of 5 pixels, one plane of it or of its filtered values.
using Halo = float[kHaloHeight][kPitch];
/// Halo after filtering along rows.
using Filtered = float[kHaloHeight][kTileWidth];

/// Loads one tile of kPlanes planes; zeros outside the image. A plane has fewer than 2^31 pixels.
template <int kPlanes>
__device__ __forceinline__ void load_halos(const float* const (&planes)[kPlanes], const Tile& tile,
                                           Halo* out) {
  constexpr int kSteps = (kPitch + 31) / 32;
  const int lane = threadIdx.x % 32, warp = threadIdx.x / 32, x = tile.x0 + lane - kSsimRadius;
  bool inside[kSteps];
#pragma unroll
  for (int step = 0; step < kSteps; ++step) {
    inside[step] = x + 32 * step >= 0 && x + 32 * step < tile.width;
  }
  int y = tile.y0 + warp - kSsimRadius, at = y * tile.width + x;
#pragma unroll
  for (int row = warp; row < kHaloHeight; row += kWarps, y += kWarps, at += kWarps * tile.width) {
    const bool there = y >= 0 && y < tile.height;
#pragma unroll
    for (int step = 0; step < kSteps; ++step) {
      if (32 * step + lane >= kPitch) continue;
      for (int p = 0; p < kPlanes; ++p) {
        out[p][row][32 * step + lane] =
            there && inside[step] ? __ldg(planes[p] + at + 32 * step) : 0.0f;
      }
    }
  }
}

/// Loads the inputs of kColumns neighbouring results along a row.
__device__ __forceinline__ void load_row(const Halo& halo, int row, int column,
                                         float (&values)[kColumns + 12]) {
#pragma unroll
  for (int k = 0; k < kColumns + 12; k += 4) {
    const float4 four = *reinterpret_cast<const float4*>(&halo[row][column + k]);
    values[k] = four.x;
    values[k + 1] = four.y;
    values[k + 2] = four.z;
    values[k + 3] = four.w;
  }
}

/// Adds value k of the row to those of its kColumns results whose windows contain it.
__device__ __forceinline__ void add_tap(const Taps& taps, int k, float value,
                                        float (&sums)[kColumns]) {
#pragma unroll
  for (int c = 0; c < kColumns; ++c) {
    if (k - c >= 0 && k - c < kSsimTaps) sums[c] += taps.w[k - c] * value;
  }
}

__device__ __forceinline__ void store_row(const float (&sums)[kColumns], int row, int column,
                                          Filtered& out) {
  *reinterpret_cast<float4*>(&out[row][column]) = make_float4(sums[0], sums[1], sums[2], sums[3]);
}

/// Calls filter(plane, row, column) for this thread's results along the rows of kPlanes planes.
template <class Filter>
__device__ __forceinline__ void for_rows(int planes, const Filter& filter) {
  constexpr int kPerRow = kTileWidth / kColumns, kPerPlane = kHaloHeight * kPerRow;
#pragma unroll 1
  for (int i = threadIdx.x; i < planes * kPerPlane; i += kThreads) {
    const int plane = i / kPerPlane, in_plane = i - plane * kPerPlane;
    filter(plane, in_plane / kPerRow, in_plane % kPerRow * kColumns);
  }
}

/// Filters vertically: rows first … first + kRows − 1 of the tile.
__device__ __forceinline__ void filter_down(const Filtered& rows, int first, int column,
                                            const Taps& taps, float (&sums)[kRows]) {
#pragma unroll
  for (int r = 0; r < kRows; ++r) sums[r] = 0;
#pragma unroll
  for (int k = 0; k < kRows + kSsimTaps - 1; ++k) {
    const float value = rows[first + k][column];
#pragma unroll
    for (int r = 0; r < kRows; ++r) {
      if (k - r >= 0 && k - r < kSsimTaps) sums[r] += taps.w[k - r] * value;
    }
  }
}

/// Filters a, a², a b and, unless b's window means are given, b and b² along the rows.
template <bool kFixed>
__device__ __forceinline__ void filter_pair(const Halo (&images)[2], const Taps& taps,
                                            Filtered (&out)[5]) {
  for_rows(1, [&](int, int row, int column) {
    float a[kColumns + 12], b[kColumns + 12];
    load_row(images[0], row, column, a);
    load_row(images[1], row, column, b);
    float sums[5][kColumns] = {};
#pragma unroll
    for (int k = 0; k < kColumns + kSsimTaps - 1; ++k) {
      add_tap(taps, k, a[k], sums[0]);
      add_tap(taps, k, a[k] * a[k], sums[1]);
      add_tap(taps, k, a[k] * b[k], sums[2]);
      if (kFixed) continue;
      add_tap(taps, k, b[k], sums[3]);
      add_tap(taps, k, b[k] * b[k], sums[4]);
    }
#pragma unroll
    for (int q = 0; q < (kFixed ? 3 : 5); ++q) store_row(sums[q], row, column, out[q]);
  });
}

/// SSIM at every pixel of a tile, its sum, and the derivative maps.
__global__ void __launch_bounds__(kThreads, 4)
    ssim_forward(const __grid_constant__ Job in, const __grid_constant__ Taps taps) {
  __shared__ __align__(16) Halo images[2];
  __shared__ __align__(16) Filtered filtered[5];
  const Tile tile = this_tile(in);
  const PairJob& pair = in.pairs[tile.pair];
  const bool fixed = pair.mean_b != nullptr;
  load_halos<2>({pair.a + tile.plane, pair.b + tile.plane}, tile, images);
  __syncthreads();
  if (fixed) {
    filter_pair<true>(images, taps, filtered);
  } else {
    filter_pair<false>(images, taps, filtered);
  }
  __syncthreads();
  const int column = threadIdx.x % 32, first = threadIdx.x / 32 * kRows, x = tile.x0 + column;
  const int64_t map_size = static_cast<int64_t>(pair.planes) * in.height * in.width;
  float sums[5][kRows];
#pragma unroll
  for (int q = 0; q < 3; ++q) filter_down(filtered[q], first, column, taps, sums[q]);
  if (!fixed) {
    filter_down(filtered[3], first, column, taps, sums[3]);
    filter_down(filtered[4], first, column, taps, sums[4]);
  }
  float of_thread[2] = {0, 0};  // SSIM, |a − b|
#pragma unroll
  for (int r = 0; r < kRows; ++r) {
    const int row = first + r, y = tile.y0 + row;
    if (x >= tile.width || y >= tile.height) continue;
    const int64_t pixel = tile.plane + (y * tile.width + x);
    SsimMoments<float> moments;
    moments.a = sums[0][r];
    moments.aa = sums[1][r];
    moments.ab = sums[2][r];
    moments.b = fixed ? __ldg(pair.mean_b + pixel) : sums[3][r];
    moments.bb = fixed ? __ldg(pair.square_b + pixel) : sums[4][r];
    const SsimTerms<float> terms = ssim_terms(moments);
    of_thread[0] += terms.value;
    of_thread[1] += fabsf(images[0][row + kSsimRadius][column + kSsimRadius] -
                          images[1][row + kSsimRadius][column + kSsimRadius]);
    if (pair.maps == nullptr) continue;
    const SsimDerivatives<float> d = ssim_derivatives(moments, terms);
    pair.maps[pixel] = d.a;
    pair.maps[map_size + pixel] = d.square;
    pair.maps[2 * map_size + pixel] = d.ab;
    if (pair.maps_of_b) pair.maps[3 * map_size + pixel] = d.b;
  }
  double of_block[2];
  kernel::block_sum<kThreads>(of_thread, of_block);
  if (threadIdx.x == 0) {
    const int64_t block =
        (static_cast<int64_t>(blockIdx.z) * gridDim.y + blockIdx.y) * gridDim.x + blockIdx.x;
    in.partial[2 * block] = of_block[0];
    in.partial[2 * block + 1] = of_block[1];
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

/// Filters derivative maps along the rows.
__device__ __forceinline__ void filter_maps(const Halo* maps, int count, const Taps& taps,
                                            Filtered* out) {
  for_rows(count, [&](int map, int row, int column) {
    float values[kColumns + 12], sums[kColumns] = {};
    load_row(maps[map], row, column, values);
#pragma unroll
    for (int k = 0; k < kColumns + kSsimTaps - 1; ++k) add_tap(taps, k, values[k], sums);
    store_row(sums, row, column, out[map]);
  });
}

/// Filters the derivative maps and combines them to the gradients.
__global__ void __launch_bounds__(kThreads, 5)
    ssim_backward(const __grid_constant__ Job in, const __grid_constant__ Taps taps) {
  __shared__ __align__(16) Halo halos[4];
  __shared__ __align__(16) Filtered filtered[4];
  const Tile tile = this_tile(in);
  const PairJob& pair = in.pairs[tile.pair];
  const bool of_a = pair.grad_a != nullptr, of_b = pair.grad_b != nullptr;
  if (!of_a && !of_b) return;
  const int64_t map_size = static_cast<int64_t>(pair.planes) * in.height * in.width;
  const float* const maps = pair.maps + tile.plane;
  load_halos<3>({maps, maps + map_size, maps + 2 * map_size}, tile, halos);
  if (of_b) load_halos<1>({maps + 3 * map_size}, tile, halos + 3);
  __syncthreads();
  filter_maps(halos, of_b ? 4 : 3, taps, filtered);
  __syncthreads();
  const float upstream = upstream_of(in, pair);
  const float weight_ssim = upstream * pair.weight_ssim, weight_l1 = upstream * pair.weight_l1;
  const int column = threadIdx.x % 32, first = threadIdx.x / 32 * kRows, x = tile.x0 + column;
  float on_a[kRows], on_square[kRows], on_product[kRows], on_b[kRows];
  if (of_a) filter_down(filtered[0], first, column, taps, on_a);
  filter_down(filtered[1], first, column, taps, on_square);
  filter_down(filtered[2], first, column, taps, on_product);
  if (of_b) filter_down(filtered[3], first, column, taps, on_b);
#pragma unroll
  for (int r = 0; r < kRows; ++r) {
    const int y = tile.y0 + first + r;
    if (x >= tile.width || y >= tile.height) continue;
    const int64_t pixel = tile.plane + (y * tile.width + x);
    const float a = __ldg(pair.a + pixel), b = __ldg(pair.b + pixel);
    const float sign = weight_l1 * l1_gradient(a, b);
    if (of_a) {
      pair.grad_a[pixel] =
          weight_ssim * ssim_gradient(on_a[r], on_square[r], on_product[r], a, b) + sign;
    }
    if (of_b) {
      pair.grad_b[pixel] =
          weight_ssim * ssim_gradient(on_b[r], on_square[r], on_product[r], b, a) - sign;
    }
  }
}

/// One warp per pair adds its blocks' sums in a fixed order, so that the value is deterministic.
/// Then one thread applies the weights of the terms.
__global__ void ssim_finish(Job in, int64_t blocks_per_plane) {
  __shared__ float values[kMostPairs];
  const int index = threadIdx.x / 32, lane = threadIdx.x % 32;
  const PairJob& pair = in.pairs[index];
  const double2* const sums = reinterpret_cast<const double2*>(in.partial);
  const int64_t begin = pair.first_plane * blocks_per_plane;
  const int64_t end = begin + pair.planes * blocks_per_plane;
  double of_pair[2] = {0, 0};  // SSIM, |a − b|
#pragma unroll 8
  for (int64_t block = begin + lane; block < end; block += 32) {
    const double2 both = sums[block];
    of_pair[0] += both.x;
    of_pair[1] += both.y;
  }
  kernel::warp_sum(of_pair);
  if (lane == 0) {
    values[index] = static_cast<float>(in.offset + double(pair.weight_ssim) * of_pair[0] +
                                       double(pair.weight_l1) * of_pair[1]);
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

/// The batch without outputs and scratch memory.
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

/// Sets the offset of each pair's maps in one buffer; null if no gradient is required.
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
