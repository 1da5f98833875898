// SPDX-License-Identifier: Apache-2.0
#include <ATen/Dispatch.h>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

#include "jade/imaging/color_kernels.h"
#include "jade/kernel/launch.h"

namespace jade::imaging::cuda {
namespace {

constexpr int kThreads = 256;

template <class T>
__global__ void gray_kernel(const T* rgb, T* gray, int64_t plane, int64_t count) {
  const int64_t i = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (i >= count) return;
  const T* const red = rgb + i / plane * 3 * plane + i % plane;
  gray[i] = luma(red[0], red[plane], red[2 * plane]);
}

template <class T>
__global__ void gray_gradient_kernel(const T* of_gray, T* of_rgb, int64_t plane, int64_t count) {
  const int64_t i = blockIdx.x * static_cast<int64_t>(kThreads) + threadIdx.x;
  if (i >= count) return;
  T* const red = of_rgb + i / plane * 3 * plane + i % plane;
  for (int64_t c = 0; c < 3; ++c) red[c * plane] = luma_gradient(c, of_gray[i]);
}

}  // namespace

void gray(const at::Tensor& rgb, at::Tensor& gray) {
  const int64_t count = gray.numel();
  if (count == 0) return;
  const c10::cuda::CUDAGuard guard(rgb.device());
  AT_DISPATCH_FLOATING_TYPES(rgb.scalar_type(), "gray", [&] {
    gray_kernel<<<kernel::grid_size(count, kThreads), kThreads, 0,
                  c10::cuda::getCurrentCUDAStream()>>>(rgb.const_data_ptr<scalar_t>(),
                                                       gray.mutable_data_ptr<scalar_t>(),
                                                       rgb.size(-2) * rgb.size(-1), count);
  });
  kernel::check_launch("an image in gray");
}

void gray_gradient(const at::Tensor& of_gray, at::Tensor& of_rgb) {
  const int64_t count = of_gray.numel();
  if (count == 0) return;
  const c10::cuda::CUDAGuard guard(of_rgb.device());
  AT_DISPATCH_FLOATING_TYPES(of_rgb.scalar_type(), "gray_gradient", [&] {
    gray_gradient_kernel<<<kernel::grid_size(count, kThreads), kThreads, 0,
                           c10::cuda::getCurrentCUDAStream()>>>(
        of_gray.const_data_ptr<scalar_t>(), of_rgb.mutable_data_ptr<scalar_t>(),
        of_rgb.size(-2) * of_rgb.size(-1), count);
  });
  kernel::check_launch("an image in gray, backward");
}

}  // namespace jade::imaging::cuda
