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
/// Sums over the table are kept in fixed point: additions of integers do not depend on their order.
constexpr double kFixedPoint = 1125899906842624.0;  // 2^50

__global__ void forward_kernel(const float* image, const float* table, const float* weights,
                               float* out, int64_t outputs, int64_t images) {
  const int64_t p = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (p >= outputs) return;
  float sum = 0;
  for (int64_t k = 0; k < images; ++k) {
    const Cell<float> cell = cell_of(image[k * outputs + p]);
    const float value = interpolate(cell, __ldg(table + cell.index), __ldg(table + cell.index + 1));
    sum += weights == nullptr ? value : __ldg(weights + k) * value;
  }
  out[p] = sum;
}

__global__ void backward_kernel(const float* image, const float* table, const float* gradient,
                                const float* weights, int64_t pixels, int64_t count,
                                float* of_image, unsigned long long* of_table) {
  extern __shared__ unsigned long long sums[];
  if (of_table != nullptr) {
    for (int i = threadIdx.x; i < kKnots; i += kThreads) sums[i] = 0;
    __syncthreads();
  }
  const int64_t stride = static_cast<int64_t>(gridDim.x) * kThreads;
  for (int64_t i = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x; i < count;
       i += stride) {
    const Cell<float> cell = cell_of(image[i]);
    const float share = weights == nullptr ? 1.f : __ldg(weights + i / pixels);
    const float g = gradient[i % pixels] * share;
    if (of_image != nullptr) {
      of_image[i] = gradient_of_x(g, __ldg(table + cell.index), __ldg(table + cell.index + 1));
    }
    if (of_table != nullptr) {
      const double upper = static_cast<double>(gradient_of_upper(cell, g));
      const double lower = static_cast<double>(g * (1 - cell.fraction));
      atomicAdd(sums + cell.index,
                static_cast<unsigned long long>(__double2ll_rn(lower * kFixedPoint)));
      atomicAdd(sums + cell.index + 1,
                static_cast<unsigned long long>(__double2ll_rn(upper * kFixedPoint)));
    }
  }
  if (of_table == nullptr) return;
  __syncthreads();
  for (int i = threadIdx.x; i < kKnots; i += kThreads) {
    if (sums[i] != 0) atomicAdd(of_table + i, sums[i]);
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
  // Few blocks with long loops when each has a table of its own to add up.
  const int64_t blocks = wants_table ? std::min<int64_t>(kernel::block_count(count, kThreads), 528)
                                     : kernel::block_count(count, kThreads);
  const size_t shared = wants_table ? sizeof(unsigned long long) * kKnots : 0;
  backward_kernel<<<static_cast<unsigned>(blocks), kThreads, shared,
                    c10::cuda::getCurrentCUDAStream()>>>(
      args.image.const_data_ptr<float>(), args.table.const_data_ptr<float>(),
      gradient.const_data_ptr<float>(),
      args.weights.defined() ? args.weights.const_data_ptr<float>() : nullptr, gradient.numel(),
      count, wants_image ? result.image.mutable_data_ptr<float>() : nullptr,
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
