// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/kernel/launch.h"
#include "jade/response/table.h"

namespace jade::response::cuda {
namespace {

constexpr int kTableKnots = 64;  ///< per block
constexpr int kParts = 4;        ///< threads per knot: each computes every fourth unit of a layer
constexpr int kTableThreads = kTableKnots * kParts;
constexpr int kSumThreads = 128;
constexpr int kPitch = kTableKnots + 1;  ///< neighbouring units are in different banks

struct Network {
  const float* parameters[8];
};

/// A hidden layer's units at a block's knots, in shared memory: three layers and their gradients
/// would exceed a thread's registers.
using Layer = float[kHidden][kPitch];

struct Activations {
  Layer first, second, third;
};

/// All parameters, loaded by the whole block.
__device__ __forceinline__ void load_parameters(const Network& network,
                                                float (&all)[kResponseParameters]) {
  constexpr int kOffsets[9] = {0, 16, 32, 288, 304, 560, 576, 592, 593};
#pragma unroll
  for (int p = 0; p < 8; ++p) {
    for (int i = threadIdx.x; i < kOffsets[p + 1] - kOffsets[p]; i += blockDim.x) {
      all[kOffsets[p] + i] = network.parameters[p][i];
    }
  }
  __syncthreads();
}

__device__ __forceinline__ void load_units(const Layer& layer, int n, float (&units)[kHidden]) {
#pragma unroll
  for (int k = 0; k < kHidden; ++k) units[k] = layer[k][n];
}

/// A thread's knot, which is column n of every layer, and its units.
struct Share {
  int n = threadIdx.x % kTableKnots, part = threadIdx.x / kTableKnots;
};

/// Synchronises the block after `out` is complete.
__device__ __forceinline__ void hidden_layer(const float* weights, const float* bias,
                                             const Layer& in, const Share& mine, Layer& out) {
  float units[kHidden];
  load_units(in, mine.n, units);
#pragma unroll
  for (int i = 0; i < kHidden / kParts; ++i) {
    const int j = kParts * i + mine.part;
    float sum = bias[j];
#pragma unroll
    for (int k = 0; k < kHidden; ++k) sum += weights[j * kHidden + k] * units[k];
    out[j][mine.n] = fmaxf(sum, 0.f);
  }
  __syncthreads();
}

/// The gradient of a layer's input, from that of its output before ReLU; 0 where ReLU was inactive.
__device__ __forceinline__ void hidden_gradient(const float* weights, const Layer& of_out,
                                                const Layer& in, const Share& mine, Layer& of_in) {
  float gradients[kHidden];
  load_units(of_out, mine.n, gradients);
#pragma unroll
  for (int i = 0; i < kHidden / kParts; ++i) {
    const int k = kParts * i + mine.part;
    float sum = 0;
#pragma unroll
    for (int j = 0; j < kHidden; ++j) sum += weights[j * kHidden + k] * gradients[j];
    of_in[k][mine.n] = in[k][mine.n] > 0 ? sum : 0.f;
  }
  __syncthreads();
}

__device__ float knot_at(int64_t i) {
  return static_cast<float>(static_cast<double>(i) * (kResponseRange / (kKnots - 1)));
}

__device__ __forceinline__ void run_network(const float (&all)[kResponseParameters], float x,
                                            const Share& mine, Activations& units) {
  for (int j = mine.part; j < kHidden; j += kParts) {
    units.first[j][mine.n] = fmaxf(all[j] * x + all[16 + j], 0.f);
  }
  __syncthreads();
  hidden_layer(all + 32, all + 288, units.first, mine, units.second);
  hidden_layer(all + 304, all + 560, units.second, mine, units.third);
}

__global__ void __launch_bounds__(kTableThreads) table_kernel(Network network, float* table) {
  __shared__ float all[kResponseParameters];
  __shared__ Activations units;
  load_parameters(network, all);
  const Share mine;
  const int64_t i = blockIdx.x * static_cast<int64_t>(kTableKnots) + mine.n;
  const float x = i < kKnots ? knot_at(i) : 0.f;
  run_network(all, x, mine, units);
  if (i >= kKnots || mine.part != 0) return;
  float sum = all[592];
#pragma unroll
  for (int k = 0; k < kHidden; ++k) sum += all[576 + k] * units.third[k][mine.n];
  table[i] = 1.f / (1.f + expf(-(0.1f * sum + x)));
}

/// Factors of the sums over a block's knots: outputs of the previous layers, and gradients of the
/// layers' outputs before ReLU.
struct Products {
  float x[kPitch], of_out[kPitch];
  Activations units;
  Layer of_first, of_second, of_third;
};

__device__ __forceinline__ float sum_of_products(const float* a, const float* b) {
  float sum = 0;
#pragma unroll 8
  for (int n = 0; n < kTableKnots; ++n) sum += a[n] * (b == nullptr ? 1.f : b[n]);
  return sum;
}

/// The sum over the block's knots for one parameter.
__device__ __forceinline__ float parameter_gradient(const Products& in, int p) {
  if (p < 16) return sum_of_products(in.of_first[p], in.x);
  if (p < 32) return sum_of_products(in.of_first[p - 16], nullptr);
  if (p < 288) return sum_of_products(in.of_second[(p - 32) / 16], in.units.first[(p - 32) % 16]);
  if (p < 304) return sum_of_products(in.of_second[p - 288], nullptr);
  if (p < 560) return sum_of_products(in.of_third[(p - 304) / 16], in.units.second[(p - 304) % 16]);
  if (p < 576) return sum_of_products(in.of_third[p - 560], nullptr);
  if (p < 592) return sum_of_products(in.of_out, in.units.third[p - 576]);
  return sum_of_products(in.of_out, nullptr);
}

/// @param partial  [blocks, 593]
__global__ void __launch_bounds__(kTableThreads)
    table_gradient_kernel(Network network, const float* table, const float* of_table,
                          float* partial) {
  __shared__ float all[kResponseParameters];
  __shared__ Products products;
  load_parameters(network, all);
  const Share mine;
  const int n = mine.n;
  const int64_t i = blockIdx.x * static_cast<int64_t>(kTableKnots) + n;
  const bool inside = i < kKnots;
  const float x = inside ? knot_at(i) : 0.f;
  Activations& units = products.units;
  run_network(all, x, mine, units);
  const float y = inside ? table[i] : 0.f;
  const float of_out = inside ? 0.1f * of_table[i] * y * (1 - y) : 0.f;
  if (mine.part == 0) {
    products.x[n] = x;
    products.of_out[n] = of_out;
  }
  for (int k = mine.part; k < kHidden; k += kParts) {
    products.of_third[k][n] = units.third[k][n] > 0 ? all[576 + k] * of_out : 0.f;
  }
  __syncthreads();
  hidden_gradient(all + 304, products.of_third, units.second, mine, products.of_second);
  hidden_gradient(all + 32, products.of_second, units.first, mine, products.of_first);
  for (int p = threadIdx.x; p < kResponseParameters; p += kTableThreads) {
    partial[blockIdx.x * kResponseParameters + p] = parameter_gradient(products, p);
  }
}

__global__ void __launch_bounds__(kSumThreads)
    table_sum_kernel(const float* partial, int blocks, float* out) {
  const int p = blockIdx.x * kSumThreads + threadIdx.x;
  if (p >= kResponseParameters) return;
  float sum = 0;
#pragma unroll 8
  for (int block = 0; block < blocks; ++block) sum += partial[block * kResponseParameters + p];
  out[p] = sum;
}

Network network_of(const NetworkWeights& weights) {
  Network network{};
  for (size_t p = 0; p < weights.size(); ++p) {
    network.parameters[p] = weights[p].const_data_ptr<float>();
  }
  return network;
}

}  // namespace

at::Tensor response_table(const NetworkWeights& weights) {
  const c10::cuda::CUDAGuard guard(weights[0].device());
  at::Tensor table = at::empty({kKnots}, weights[0].options().requires_grad(false));
  table_kernel<<<kernel::grid_size(kKnots, kTableKnots), kTableThreads, 0,
                 c10::cuda::getCurrentCUDAStream()>>>(network_of(weights),
                                                      table.mutable_data_ptr<float>());
  kernel::check_launch("the table of the camera response");
  return table;
}

at::Tensor response_table_gradient(const NetworkWeights& weights, const at::Tensor& table,
                                   const at::Tensor& of_table) {
  const c10::cuda::CUDAGuard guard(table.device());
  const auto stream = c10::cuda::getCurrentCUDAStream();
  const auto blocks = static_cast<int>(kernel::block_count(kKnots, kTableKnots));
  const at::Tensor partial = at::empty({blocks, kResponseParameters}, table.options());
  at::Tensor out = at::empty({kResponseParameters}, table.options());
  table_gradient_kernel<<<static_cast<unsigned>(blocks), kTableThreads, 0, stream>>>(
      network_of(weights), table.const_data_ptr<float>(), of_table.const_data_ptr<float>(),
      partial.mutable_data_ptr<float>());
  kernel::check_launch("the table of the camera response, backward");
  table_sum_kernel<<<kernel::grid_size(kResponseParameters, kSumThreads), kSumThreads, 0, stream>>>(
      partial.const_data_ptr<float>(), blocks, out.mutable_data_ptr<float>());
  kernel::check_launch("the table of the camera response, sum");
  return out;
}

}  // namespace jade::response::cuda
