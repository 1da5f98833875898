// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <algorithm>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/kernel/block_sum.cuh"
#include "jade/kernel/launch.h"
#include "jade/losses/route_kernels.h"

namespace jade::losses::cuda {
namespace {

constexpr int kThreads = 256;

/// Few enough that the second kernel, a single block, has little to add.
constexpr int64_t kMostBlocks = 1024;

/// `parts` is [2, blocks].
__global__ void __launch_bounds__(kThreads)
    route_parts_kernel(const __grid_constant__ RouteImages<float> in, double* parts) {
  const int64_t stride = gridDim.x * static_cast<int64_t>(kThreads);
  double of_thread[2] = {0, 0};  // render, reblur
  for (int64_t pixel = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x; pixel < in.plane;
       pixel += stride) {
    const RouteParts<float> residuals = route_residuals(in, pixel);
    of_thread[0] += residuals.render;
    of_thread[1] += residuals.reblur;
  }
  double of_block[2];
  kernel::block_sum<kThreads>(of_thread, of_block);
  if (threadIdx.x == 0) {
    parts[blockIdx.x] = of_block[0];
    parts[gridDim.x + blockIdx.x] = of_block[1];
  }
}

/// A single block, which always adds in the same order.
__global__ void __launch_bounds__(kThreads)
    route_sum_kernel(const double* parts, int blocks, double count, double reblur_weight,
                     float* values) {
  double of_thread[2] = {0, 0};
  for (int block = threadIdx.x; block < blocks; block += kThreads) {
    of_thread[0] += parts[block];
    of_thread[1] += parts[blocks + block];
  }
  double total[2];
  kernel::block_sum<kThreads>(of_thread, total);
  if (threadIdx.x != 0) return;
  const double render = total[0] / count, reblur = total[1] / count * reblur_weight;
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
