// SPDX-License-Identifier: Apache-2.0
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/kernel/block_sum.cuh"
#include "jade/kernel/launch.h"
#include "jade/losses/event_loss_kernels.h"

namespace jade::losses::cuda {
namespace {

constexpr int kThreads = 256;

/// One thread per sampled pixel. `values` and `weights` are [P].
__global__ void __launch_bounds__(kThreads)
    event_terms_kernel(const __grid_constant__ EventPixels<float> in, double* residuals,
                       double* values, double* weights) {
  const int64_t p = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (p >= in.count) return;
  const EventTerm term = event_term(in, in.indices[p]);
  residuals[p] = term.residual;
  values[p] = term.value;
  weights[p] = term.weight;
}

/// A single block, which always adds in the same order.
__global__ void __launch_bounds__(kThreads)
    event_sum_kernel(const double* values, const double* weights, int64_t count, float* loss,
                     double* weight) {
  double of_thread[2] = {0, 0};  // value, weight
  for (int64_t p = threadIdx.x; p < count; p += kThreads) {
    of_thread[0] += values[p];
    of_thread[1] += weights[p];
  }
  double total[2];
  kernel::block_sum<kThreads>(of_thread, total);
  if (threadIdx.x == 0) {
    *weight = kernel::max(total[1], kLeastWeight);
    *loss = static_cast<float>(total[0] / *weight);
  }
}

__global__ void __launch_bounds__(kThreads)
    event_gradient_kernel(const __grid_constant__ EventPixels<float> in, const double* residuals,
                          const double* weight, const float* of_loss, float* of_renders) {
  const int64_t p = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (p >= in.count) return;
  const int64_t pixel = in.indices[p];
  const double scale = static_cast<double>(*of_loss) / *weight;
  event_term_adjoint(in, pixel, scale * residuals[p], [&](int64_t side, int64_t c, float gradient) {
    atomicAdd(of_renders + (3 * side + c) * in.plane + pixel, gradient);
  });
}

}  // namespace

void event_loss(const EventPair& events, at::Tensor& loss, at::Tensor& residuals,
                at::Tensor& weight) {
  const c10::cuda::CUDAGuard guard(events.renders.device());
  const auto stream = c10::cuda::getCurrentCUDAStream();
  const EventPixels<float> in = pixels_of<float>(events);
  const at::Tensor sums = at::empty({2, in.count}, residuals.options());
  double* const values = sums.mutable_data_ptr<double>();
  if (in.count > 0) {
    event_terms_kernel<<<kernel::grid_size(in.count, kThreads), kThreads, 0, stream>>>(
        in, residuals.mutable_data_ptr<double>(), values, values + in.count);
  }
  event_sum_kernel<<<1, kThreads, 0, stream>>>(values, values + in.count, in.count,
                                               loss.mutable_data_ptr<float>(),
                                               weight.mutable_data_ptr<double>());
  kernel::check_launch("the loss of the events");
}

void event_loss_gradient(const EventPair& events, const at::Tensor& residuals,
                         const at::Tensor& weight, const at::Tensor& of_loss,
                         at::Tensor& of_renders) {
  const EventPixels<float> in = pixels_of<float>(events);
  if (in.count == 0) return;
  const c10::cuda::CUDAGuard guard(events.renders.device());
  event_gradient_kernel<<<kernel::grid_size(in.count, kThreads), kThreads, 0,
                          c10::cuda::getCurrentCUDAStream()>>>(
      in, residuals.const_data_ptr<double>(), weight.const_data_ptr<double>(),
      of_loss.const_data_ptr<float>(), of_renders.mutable_data_ptr<float>());
  kernel::check_launch("the loss of the events, backward");
}

}  // namespace jade::losses::cuda
