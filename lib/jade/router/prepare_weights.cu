// SPDX-License-Identifier: Apache-2.0
// Reorders the weights of all convolutions for the tensor cores, in one launch.
#include <algorithm>

#include "jade/router/conv_layer.h"
#include "jade/router/conv_shape.cuh"

namespace jade::router::cuda {
namespace {

constexpr int kThreads = 256, kParts = 4;  ///< threads of a block, blocks of a convolution

struct Preparation {
  Plans plans;
  const float* weights[kLayers];
  uint32_t* prepared;
};

__device__ float prepared_weight(const Prepared& plan, const float* weights, int o, int c, int dy,
                                 int dx) {
  const int k = plan.kernel;
  if (o >= plan.out || c >= plan.in || dx >= k) return 0;
  const int tap = dy * k + dx;
  return plan.turned ? weights[(c * plan.layer_in + plan.first + o) * k * k + k * k - 1 - tap]
                     : weights[(o * plan.layer_in + c) * k * k + tap];
}

__global__ void __launch_bounds__(kThreads) prepare_kernel(Preparation args) {
  __shared__ uint32_t slots[kThreads / 32];
  const Prepared& plan = args.plans.of[blockIdx.x];
  const float* const weights = args.weights[plan.layer];
  float largest = 0;
  const int count = plan.layer_in * plan.layer_out * plan.kernel * plan.kernel;
  for (int i = threadIdx.x; i < count; i += kThreads) {
    largest = fmaxf(largest, fabsf(weights[i]));
  }
  const Scale scale(block_largest<kThreads>(largest, slots));
  if (blockIdx.y == 0 && threadIdx.x == 0)
    args.prepared[blockIdx.x] = __float_as_uint(scale.inverse);

  uint2* const to = reinterpret_cast<uint2*>(args.prepared) + plan.begin;
  for (int i = blockIdx.y * kThreads + threadIdx.x;
       i < plan.steps * plan.kernel * plan.columns * 32; i += kParts * kThreads) {
    const int lane = i % 32, o = i / 32 % plan.columns * 8 + lane / 4;
    const int dy = i / (32 * plan.columns) % plan.kernel;
    const int step = i / (32 * plan.columns * plan.kernel);
    uint32_t words[2];
    for (int half = 0; half < 2; ++half) {
      const int slot = (plan.step_per_tap ? step * plan.stride : step * 8) + lane % 4 + 4 * half;
      const int dx = slot / plan.stride, c = slot % plan.stride * 2;
      words[half] =
          kernel::to_halves(scale.factor * prepared_weight(plan, weights, o, c, dy, dx),
                            scale.factor * prepared_weight(plan, weights, o, c + 1, dy, dx));
    }
    to[i] = make_uint2(words[0], words[1]);
  }
}

}  // namespace

int64_t prepared_words() { return int64_t{2} * kPlans.end; }

void prepare_weights(const Network& net, cudaStream_t stream) {
  Preparation preparation{kPlans, {}, net.prepared};
  std::copy(net.weights, net.weights + kLayers, preparation.weights);
  prepare_kernel<<<dim3(kProducts, kParts), kThreads, 0, stream>>>(preparation);
}

}  // namespace jade::router::cuda
