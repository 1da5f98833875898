// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <ATen/ops/empty_like.h>
#include <ATen/ops/zeros.h>
#include <ATen/ops/zeros_like.h>
#include <algorithm>
#include <c10/cuda/CUDAStream.h>

#include "jade/kernel/launch.h"
#include "jade/response/lookup.h"
#include "jade/response/lookup_math.h"

namespace jade::response::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kTableThreads = 512;  ///< of a block that adds up a table of its own
constexpr int kTableBlocks = 264;   ///< and such blocks at most: two for each multiprocessor
/// Sums over the table are kept in fixed point: additions of integers do not depend on their order.
constexpr double kFixedPoint = 1125899906842624.0;  // 2^50

/// A block's sums over the table, 64-bit numbers in two halves: a multiprocessor adds 32 bits in
/// shared memory by itself and 64 only in a loop that tries until nobody else came between.
struct TableSums {
  uint32_t low[kKnots], high[kKnots];

  __device__ void add(int knot, float value) {
    const auto fixed =
        static_cast<uint64_t>(__double2ll_rn(static_cast<double>(value) * kFixedPoint));
    const auto part = static_cast<uint32_t>(fixed);
    const uint32_t carry = atomicAdd(low + knot, part) + part < part ? 1 : 0;
    const uint32_t rest = static_cast<uint32_t>(fixed >> 32) + carry;
    if (rest != 0) atomicAdd(high + knot, rest);
  }
  __device__ unsigned long long at(int knot) const {
    return static_cast<unsigned long long>(high[knot]) << 32 | low[knot];
  }
};

__global__ void forward_kernel(const float* __restrict__ image, const float* __restrict__ table,
                               const float* __restrict__ weights, float* __restrict__ out,
                               int64_t outputs, int64_t images) {
  const int64_t p = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (p >= outputs) return;
  float sum = 0;
#pragma unroll 4
  for (int64_t k = 0; k < images; ++k) {
    const Cell<float> cell = cell_of(image[k * outputs + p]);
    const float value = interpolate(cell, __ldg(table + cell.index), __ldg(table + cell.index + 1));
    sum += weights == nullptr ? value : __ldg(weights + k) * value;
  }
  out[p] = sum;
}

/// A thread per pixel, for all images. of_table needs blocks of kTableThreads and a TableSums of
/// shared memory.
__global__ void backward_kernel(const float* __restrict__ image, const float* __restrict__ table,
                                const float* __restrict__ gradient,
                                const float* __restrict__ weights, int64_t pixels, int64_t images,
                                float* __restrict__ of_image,
                                unsigned long long* __restrict__ of_table) {
  extern __shared__ TableSums sums[];
  if (of_table != nullptr) {
    for (int i = threadIdx.x; i < kKnots; i += blockDim.x) sums->low[i] = sums->high[i] = 0;
    __syncthreads();
  }
  const int64_t stride = static_cast<int64_t>(gridDim.x) * blockDim.x;
  for (int64_t p = blockIdx.x * static_cast<int64_t>(blockDim.x) + threadIdx.x; p < pixels;
       p += stride) {
    const float of_out = gradient[p];
#pragma unroll 4
    for (int64_t k = 0; k < images; ++k) {
      const int64_t i = k * pixels + p;
      const Cell<float> cell = cell_of(image[i]);
      const float g = weights == nullptr ? of_out : of_out * __ldg(weights + k);
      if (of_image != nullptr) {
        of_image[i] = gradient_of_x(g, __ldg(table + cell.index), __ldg(table + cell.index + 1));
      }
      if (of_table != nullptr) {
        sums->add(cell.index, g * (1 - cell.fraction));
        sums->add(cell.index + 1, gradient_of_upper(cell, g));
      }
    }
  }
  if (of_table == nullptr) return;
  __syncthreads();
  for (int i = threadIdx.x; i < kKnots; i += blockDim.x) {
    if (sums->at(i) != 0) atomicAdd(of_table + i, sums->at(i));
  }
}

__global__ void to_float_kernel(const unsigned long long* sums, float* out) {
  const int i = blockIdx.x * kThreads + threadIdx.x;
  if (i < kKnots) {
    out[i] = static_cast<float>(static_cast<double>(static_cast<long long>(sums[i])) / kFixedPoint);
  }
}

}  // namespace

at::Tensor lookup(const Lookup& args) {
  const bool sums = args.weights.defined();
  at::Tensor out = sums ? at::empty(args.image.sizes().slice(1), args.image.options())
                        : at::empty_like(args.image);
  if (out.numel() == 0) return out;
  forward_kernel<<<kernel::grid_size(out.numel(), kThreads), kThreads, 0,
                   c10::cuda::getCurrentCUDAStream()>>>(
      args.image.const_data_ptr<float>(), args.table.const_data_ptr<float>(),
      sums ? args.weights.const_data_ptr<float>() : nullptr, out.mutable_data_ptr<float>(),
      out.numel(), sums ? args.image.size(0) : 1);
  kernel::check_launch("the camera response");
  return out;
}

LookupGradient lookup_backward(const Lookup& args, const at::Tensor& gradient, bool wants_image,
                               bool wants_table) {
  LookupGradient result;
  if (wants_image) result.image = at::empty_like(args.image);
  at::Tensor sums;
  if (wants_table) sums = at::zeros({kKnots}, args.table.options().dtype(at::kLong));
  const int64_t count = args.image.numel();
  if (count == 0) {
    if (wants_table) result.table = at::zeros_like(args.table);
    return result;
  }
  const int64_t pixels = gradient.numel();
  const int threads = wants_table ? kTableThreads : kThreads;
  const int64_t blocks = kernel::block_count(pixels, threads);
  backward_kernel<<<
      static_cast<unsigned>(wants_table ? std::min<int64_t>(blocks, kTableBlocks) : blocks),
      threads, wants_table ? sizeof(TableSums) : 0, c10::cuda::getCurrentCUDAStream()>>>(
      args.image.const_data_ptr<float>(), args.table.const_data_ptr<float>(),
      gradient.const_data_ptr<float>(),
      args.weights.defined() ? args.weights.const_data_ptr<float>() : nullptr, pixels,
      count / pixels, wants_image ? result.image.mutable_data_ptr<float>() : nullptr,
      wants_table ? reinterpret_cast<unsigned long long*>(sums.mutable_data_ptr<int64_t>())
                  : nullptr);
  kernel::check_launch("the camera response, backward");
  if (!wants_table) return result;
  result.table = at::empty_like(args.table);
  to_float_kernel<<<kernel::grid_size(kKnots, kThreads), kThreads, 0,
                    c10::cuda::getCurrentCUDAStream()>>>(
      reinterpret_cast<const unsigned long long*>(sums.const_data_ptr<int64_t>()),
      result.table.mutable_data_ptr<float>());
  kernel::check_launch("the camera response, sums");
  return result;
}

}  // namespace jade::response::cuda
