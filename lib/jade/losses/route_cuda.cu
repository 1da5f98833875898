// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <algorithm>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/kernel/launch.h"
#include "jade/losses/route_kernels.h"

namespace jade::losses::cuda {
namespace {

constexpr int kThreads = 256;

/// So that the second kernel, of one block, has little to add.
constexpr int64_t kMostBlocks = 1024;

/// The sums of the block's values, in thread 0.
__device__ double2 sum_block(double render, double reblur) {
  __shared__ double2 sums[kThreads / 32];
  for (int offset = 16; offset > 0; offset /= 2) {
    render += __shfl_down_sync(~0u, render, offset);
    reblur += __shfl_down_sync(~0u, reblur, offset);
  }
  if (threadIdx.x % 32 == 0) sums[threadIdx.x / 32] = {render, reblur};
  __syncthreads();
  double2 total = {0, 0};
  if (threadIdx.x == 0) {
    for (const double2& each : sums) {
      total.x += each.x;
      total.y += each.y;
    }
  }
  return total;
}

/// `parts` is [2, blocks].
__global__ void __launch_bounds__(kThreads)
    route_parts_kernel(const __grid_constant__ RouteImages<float> in, double* parts) {
  const int64_t stride = gridDim.x * static_cast<int64_t>(kThreads);
  double render = 0, reblur = 0;
  for (int64_t pixel = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x; pixel < in.plane;
       pixel += stride) {
    const RouteParts<float> residuals = route_residuals(in, pixel);
    render += residuals.render;
    reblur += residuals.reblur;
  }
  const double2 total = sum_block(render, reblur);
  if (threadIdx.x == 0) {
    parts[blockIdx.x] = total.x;
    parts[gridDim.x + blockIdx.x] = total.y;
  }
}

/// One block: the same order every time.
__global__ void __launch_bounds__(kThreads)
    route_sum_kernel(const double* parts, int blocks, double count, double reblur_weight,
                     float* values) {
  double render = 0, reblur = 0;
  for (int block = threadIdx.x; block < blocks; block += kThreads) {
    render += parts[block];
    reblur += parts[blocks + block];
  }
  const double2 total = sum_block(render, reblur);
  if (threadIdx.x != 0) return;
  render = total.x / count;
  reblur = total.y / count * reblur_weight;
  values[kRouteTotal] = static_cast<float>(render + reblur);
  values[kRouteRender] = static_cast<float>(render);
  values[kRouteReblur] = static_cast<float>(reblur);
}

__global__ void __launch_bounds__(kThreads)
    route_gradient_kernel(const __grid_constant__ RouteImages<float> in, double reblur_weight,
                          const float* of_total, float* of_alpha) {
  const int64_t pixel = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (pixel >= in.plane) return;
  const double of_mean = static_cast<double>(*of_total) / static_cast<double>(3 * in.plane);
  const RouteParts<float> of{static_cast<float>(of_mean),
                             static_cast<float>(of_mean * reblur_weight)};
  of_alpha[pixel] = losses::route_gradient(in, of, pixel);
}

}  // namespace

void route_loss(const RouteTensors& images, at::Tensor& values) {
  const c10::cuda::CUDAGuard guard(images.alpha.device());
  const auto stream = c10::cuda::getCurrentCUDAStream();
  const RouteImages<float> in = pointers_of<float>(images);
  const int64_t blocks = std::min(kMostBlocks, kernel::block_count(in.plane, kThreads));
  const at::Tensor parts = at::empty({2, blocks}, values.options().dtype(at::kDouble));
  route_parts_kernel<<<static_cast<unsigned>(blocks), kThreads, 0, stream>>>(
      in, parts.mutable_data_ptr<double>());
  route_sum_kernel<<<1, kThreads, 0, stream>>>(
      parts.const_data_ptr<double>(), static_cast<int>(blocks), static_cast<double>(3 * in.plane),
      images.reblur_weight, values.mutable_data_ptr<float>());
  kernel::check_launch("the loss of the routing step");
}

void route_gradient(const RouteTensors& images, const at::Tensor& of_total, at::Tensor& of_alpha) {
  const c10::cuda::CUDAGuard guard(images.alpha.device());
  const RouteImages<float> in = pointers_of<float>(images);
  route_gradient_kernel<<<kernel::grid_size(in.plane, kThreads), kThreads, 0,
                          c10::cuda::getCurrentCUDAStream()>>>(in, images.reblur_weight,
                                                               of_total.const_data_ptr<float>(),
                                                               of_alpha.mutable_data_ptr<float>());
  kernel::check_launch("the loss of the routing step, backward");
}

}  // namespace jade::losses::cuda
