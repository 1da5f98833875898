// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <ATen/ops/empty_like.h>
#include <ATen/ops/zeros.h>
#include <algorithm>
#include <c10/cuda/CUDAStream.h>

#include "jade/kernel/launch.h"
#include "jade/response/lookup.h"
#include "jade/response/lookup_math.h"

namespace jade::response::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kTableThreads = 1024;  ///< per block with a table of its own
constexpr int kTableBlocks = 264;    ///< maximum number of such blocks: two per multiprocessor
/// Sums over the table use fixed point: integer addition does not depend on the order.
constexpr float kFixedPoint = 1125899906842624.0f;  // 2^50, by which a float is multiplied exactly

/// An image's part of a launch.
struct Job {
  const float* image;      ///< [images, pixels]
  const float* weights;    ///< [images]; null: `few`
  float few[kFewWeights];  ///< copy of the weights, or 1 for a single image
  int64_t pixels, images;
  float* out;             ///< [pixels]
  int64_t end_block;      ///< forward: the first block after this image
  const float* gradient;  ///< of out
  float* of_image;        ///< null: not requested
  int64_t first_thread;   ///< backward: thread of the first pixel

  __device__ float weight(int64_t k) const {
    return weights == nullptr ? few[k] : __ldg(weights + k);
  }
};

struct Batch {
  Job jobs[kMostLookups];
  int count;
  const float* table;
};

/// A block's sums over the table, 64-bit numbers in two halves: in shared memory 32-bit atomics are
/// native, whereas 64-bit ones are a compare-and-swap loop. The low half is signed, so that small
/// numbers of either sign seldom change the high one.
struct TableSums {
  uint32_t low[kKnots], high[kKnots];

  __device__ void add(int knot, float value) {
    const int64_t fixed = __float2ll_rn(value * kFixedPoint);
    const auto part = static_cast<uint32_t>(fixed);
    const uint32_t before = atomicAdd(low + knot, part), after = before + part;
    const bool negative = static_cast<int32_t>(part) < 0;
    uint32_t rest = static_cast<uint32_t>(fixed >> 32) + (negative ? 1 : 0);
    // Both have one sign and the sum has the other: the low half overflowed.
    if (static_cast<int32_t>((before ^ after) & (part ^ after)) < 0) rest += negative ? ~0u : 1u;
    if (rest != 0) atomicAdd(high + knot, rest);
  }
  __device__ unsigned long long at(int knot) const {
    return (static_cast<unsigned long long>(high[knot]) << 32) +
           static_cast<unsigned long long>(static_cast<long long>(static_cast<int32_t>(low[knot])));
  }
};

/// One thread per pixel of one of the results.
__global__ void __launch_bounds__(kThreads) forward_kernel(const __grid_constant__ Batch batch) {
  int index = 0;
  while (blockIdx.x >= batch.jobs[index].end_block) ++index;
  const Job& job = batch.jobs[index];
  const int64_t first_block = index == 0 ? 0 : batch.jobs[index - 1].end_block;
  const int64_t p = (blockIdx.x - first_block) * kThreads + threadIdx.x;
  if (p >= job.pixels) return;
  float sum = 0;
#pragma unroll 4
  for (int64_t k = 0; k < job.images; ++k) {
    const Cell<float> cell = cell_of(__ldg(job.image + k * job.pixels + p));
    const float* const knots = batch.table + cell.index;
    sum += job.weight(k) * interpolate(cell, __ldg(knots), __ldg(knots + 1));
  }
  job.out[p] = sum;
}

/// One pixel of a result.
template <bool kTable>
__device__ void pixel_gradients(const Job& job, const float* __restrict__ table, int64_t p,
                                TableSums* sums) {
  const float of_out = __ldg(job.gradient + p);
  float next = __ldg(job.image + p);
  // Not unrolled: few registers are available at full occupancy.
#pragma unroll 1
  for (int k = 0; k < job.images; ++k) {
    const float value = next;
    // Prefetch the next value while this one's sums are updated.
    if (k + 1 < job.images) next = __ldg(job.image + (k + 1) * job.pixels + p);
    const Cell<float> cell = cell_of(value);
    const float g = of_out * job.weight(k);
    if (job.of_image != nullptr) {
      const float* const knots = table + cell.index;
      job.of_image[k * job.pixels + p] = gradient_of_x(g, __ldg(knots), __ldg(knots + 1));
    }
    if constexpr (kTable) {
      sums->add(cell.index, g * (1 - cell.fraction));
      sums->add(cell.index + 1, gradient_of_upper(cell, g));
    }
  }
}

/// All threads share the pixels of every result. kTable needs a TableSums in shared memory.
template <bool kTable>
__global__ void __launch_bounds__(kTableThreads, 2)
    backward_kernel(const __grid_constant__ Batch batch,
                    unsigned long long* __restrict__ of_table) {
  extern __shared__ TableSums sums[];
  if constexpr (kTable) {
    for (int i = threadIdx.x; i < kKnots; i += kTableThreads) sums->low[i] = sums->high[i] = 0;
    __syncthreads();
  }
  const int64_t threads = static_cast<int64_t>(gridDim.x) * kTableThreads;
  const int64_t me = blockIdx.x * static_cast<int64_t>(kTableThreads) + threadIdx.x;
  for (int j = 0; j < batch.count; ++j) {
    const Job& job = batch.jobs[j];
    const int64_t first = me - job.first_thread;
    for (int64_t p = first < 0 ? first + threads : first; p < job.pixels; p += threads) {
      pixel_gradients<kTable>(job, batch.table, p, sums);
    }
  }
  if constexpr (kTable) {
    __syncthreads();
    for (int i = threadIdx.x; i < kKnots; i += kTableThreads) {
      if (sums->at(i) != 0) atomicAdd(of_table + i, sums->at(i));
    }
  }
}

__global__ void to_float_kernel(const unsigned long long* sums, float* out) {
  const int i = blockIdx.x * kThreads + threadIdx.x;
  if (i < kKnots) {
    out[i] = static_cast<float>(static_cast<double>(static_cast<long long>(sums[i])) / kFixedPoint);
  }
}

Job job_of(const Lookup& args, int64_t pixels) {
  Job job{};
  job.image = args.image.const_data_ptr<float>();
  job.pixels = pixels;
  job.images = pixels == 0 ? 0 : args.image.numel() / pixels;
  job.few[0] = 1;
  if (!args.weights.defined()) return job;
  const float* const weights = args.weights.const_data_ptr<float>();
  if (args.weights.is_cpu() && job.images <= kFewWeights) {
    std::copy_n(weights, job.images, job.few);
  } else {
    job.weights = weights;
  }
  return job;
}

template <bool kTable>
void run_backward(const Batch& batch, int64_t blocks, const at::Tensor& sums) {
  backward_kernel<kTable><<<static_cast<unsigned>(blocks), kTableThreads,
                            kTable ? sizeof(TableSums) : 0, c10::cuda::getCurrentCUDAStream()>>>(
      batch,
      kTable ? reinterpret_cast<unsigned long long*>(sums.mutable_data_ptr<int64_t>()) : nullptr);
  kernel::check_launch("the camera response, backward");
}

}  // namespace

std::vector<at::Tensor> lookup(const Lookups& args) {
  Batch batch{};
  batch.table = args.table.const_data_ptr<float>();
  std::vector<at::Tensor> results;
  int64_t blocks = 0;
  for (const Lookup& each : args.images) {
    results.push_back(each.weights.defined()
                          ? at::empty(each.image.sizes().slice(1), each.image.options())
                          : at::empty_like(each.image));
    Job& job = batch.jobs[batch.count++];
    job = job_of(each, results.back().numel());
    job.out = results.back().mutable_data_ptr<float>();
    blocks += kernel::block_count(job.pixels, kThreads);
    job.end_block = blocks;
  }
  if (blocks == 0) return results;
  forward_kernel<<<static_cast<unsigned>(blocks), kThreads, 0, c10::cuda::getCurrentCUDAStream()>>>(
      batch);
  kernel::check_launch("the camera response");
  return results;
}

LookupGradients lookup_backward(const Lookups& args, const std::vector<at::Tensor>& gradients,
                                const LookupWanted& wanted) {
  LookupGradients result;
  result.images.resize(args.images.size());
  Batch batch{};
  batch.table = args.table.const_data_ptr<float>();
  int64_t pixels = 0;
  for (size_t i = 0; i < args.images.size(); ++i) {
    if (!gradients[i].defined()) continue;
    const Lookup& each = args.images[i];
    if (wanted.images[i]) result.images[i] = at::empty_like(each.image);
    if (each.image.numel() == 0) continue;
    Job& job = batch.jobs[batch.count++];
    job = job_of(each, gradients[i].numel());
    job.gradient = gradients[i].const_data_ptr<float>();
    if (wanted.images[i]) job.of_image = result.images[i].mutable_data_ptr<float>();
    pixels += job.pixels;
  }
  const int64_t blocks =
      std::clamp<int64_t>(kernel::block_count(pixels, kTableThreads), 1, kTableBlocks);
  // An image starts at the thread after the previous image's last, so that threads have equal work.
  int64_t next = 0;
  for (int j = 0; j < batch.count; ++j) {
    batch.jobs[j].first_thread = next;
    next = (next + batch.jobs[j].pixels) % (blocks * kTableThreads);
  }
  if (!wanted.table) {
    run_backward<false>(batch, blocks, {});
    return result;
  }
  const at::Tensor sums = at::zeros({kKnots}, args.table.options().dtype(at::kLong));
  run_backward<true>(batch, blocks, sums);
  result.table = at::empty_like(args.table);
  to_float_kernel<<<kernel::grid_size(kKnots, kThreads), kThreads, 0,
                    c10::cuda::getCurrentCUDAStream()>>>(
      reinterpret_cast<const unsigned long long*>(sums.const_data_ptr<int64_t>()),
      result.table.mutable_data_ptr<float>());
  kernel::check_launch("the camera response, sums");
  return result;
}

}  // namespace jade::response::cuda
