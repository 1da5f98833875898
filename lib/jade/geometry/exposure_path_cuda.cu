// SPDX-License-Identifier: Apache-2.0
#include <ATen/ops/empty.h>
#include <ATen/ops/empty_like.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/geometry/exposure_path.h"
#include "jade/geometry/exposure_path_math.h"
#include "jade/kernel/launch.h"

namespace jade::geometry::cuda {
namespace {

/// One warp: a step has K poses, 5 to 17 by default.
constexpr int kThreads = 32;

/// One thread per pose.
__global__ void path_kernel(PathPointers path, int64_t poses, double* out) {
  const int64_t m = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (m >= poses) return;
  store_motion(path_pose<double>(path, m, -1), out + 16 * m);
}

/// One block per direction, one thread per pose (or every 32nd), summed in a fixed order.
__global__ void path_backward_kernel(PathPointers path, int64_t poses, const double* gradient,
                                     double* out) {
  __shared__ double sums[kThreads];
  double sum = 0;
  for (int64_t m = threadIdx.x; m < poses; m += kThreads) {
    sum += gradient_along(path, gradient, m, static_cast<int>(blockIdx.x));
  }
  sums[threadIdx.x] = sum;
  __syncthreads();
  if (threadIdx.x != 0) return;
  for (int i = 1; i < kThreads; ++i) sum += sums[i];
  out[blockIdx.x] = sum;
}

PathPointers path_pointers(const ExposurePath& path) {
  return {path.twists.const_data_ptr<double>(), path.u.const_data_ptr<double>(),
          path.base.const_data_ptr<double>(), static_cast<int>(path.twists.size(0)), path.corrects};
}

}  // namespace

at::Tensor exposure_path(const ExposurePath& path) {
  const int64_t poses = path.u.size(0);
  at::Tensor out = at::empty({poses, 4, 4}, path.u.options());
  if (poses == 0) return out;
  path_kernel<<<kernel::grid_size(poses, kThreads), kThreads, 0,
                c10::cuda::getCurrentCUDAStream()>>>(path_pointers(path), poses,
                                                     out.mutable_data_ptr<double>());
  kernel::check_launch("the path of an exposure");
  return out;
}

at::Tensor exposure_path_backward(const ExposurePath& path, const at::Tensor& gradient) {
  at::Tensor of_twists = at::empty_like(path.twists);
  path_backward_kernel<<<static_cast<unsigned>(of_twists.numel()), kThreads, 0,
                         c10::cuda::getCurrentCUDAStream()>>>(path_pointers(path), path.u.size(0),
                                                              gradient.const_data_ptr<double>(),
                                                              of_twists.mutable_data_ptr<double>());
  kernel::check_launch("the path of an exposure, backward");
  return of_twists;
}

}  // namespace jade::geometry::cuda
