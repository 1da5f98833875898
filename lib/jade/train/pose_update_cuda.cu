// SPDX-License-Identifier: Apache-2.0
#include <c10/cuda/CUDAStream.h>

#include "jade/kernel/block_sum.cuh"
#include "jade/kernel/launch.h"
#include "jade/train/pose_update_math.h"

namespace jade::train::cuda {
namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads) accumulate_kernel(RowGradient step) {
  const int64_t i = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (i < step.size) step.gradient[i] += step.of[i];
  if (i == 0) ++step.seen[*step.row];
}

/// One block per row.
__global__ void __launch_bounds__(kThreads) rows_kernel(RowStep step) {
  const int64_t row = blockIdx.x;
  if (step.seen[row] <= 0) return;
  const double steps = step.steps[row] + 1;
  const RowConstants constants = row_constants(step, steps);
  for (int64_t i = threadIdx.x; i < step.row; i += kThreads) {
    update_number(step, constants, row * step.row + i);
  }
  __syncthreads();  // wait until all threads have read
  if (threadIdx.x == 0) {
    step.steps[row] = steps;
    step.seen[row] = 0;
  }
}

/// One block per direction; deterministic.
__global__ void __launch_bounds__(kThreads) along_kernel(GaugeStep step) {
  const double* const read = step.read + blockIdx.x * step.size;
  double of_thread[1] = {0}, total[1];
  for (int64_t i = threadIdx.x; i < step.size; i += kThreads) {
    of_thread[0] += read[i] * step.twists[i];
  }
  kernel::block_sum<kThreads>(of_thread, total);
  if (threadIdx.x == 0) step.along[blockIdx.x] = total[0];
}

__global__ void __launch_bounds__(kThreads) take_kernel(GaugeStep step) {
  const int64_t i = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (i < step.size) take_along(step, i);
}

}  // namespace

void accumulate(const RowGradient& step) {
  if (step.size == 0) return;
  accumulate_kernel<<<kernel::grid_size(step.size, kThreads), kThreads, 0,
                      c10::cuda::getCurrentCUDAStream()>>>(step);
  kernel::check_launch("the gradient of the poses");
}

void update_rows(const RowStep& step) {
  if (step.rows == 0) return;
  rows_kernel<<<static_cast<unsigned>(step.rows), kThreads, 0, c10::cuda::getCurrentCUDAStream()>>>(
      step);
  kernel::check_launch("the Adam step of the poses");
}

void remove_gauge(const GaugeStep& step) {
  if (step.ways == 0 || step.size == 0) return;
  const auto stream = c10::cuda::getCurrentCUDAStream();
  along_kernel<<<static_cast<unsigned>(step.ways), kThreads, 0, stream>>>(step);
  take_kernel<<<kernel::grid_size(step.size, kThreads), kThreads, 0, stream>>>(step);
  kernel::check_launch("holding the gauge of the poses");
}

}  // namespace jade::train::cuda
