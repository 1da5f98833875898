// SPDX-License-Identifier: Apache-2.0
#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>

#include "jade/imaging/color_kernels.h"

namespace jade::imaging::cpu {
namespace {

constexpr int64_t kGrain = 16384;

}  // namespace

void gray(const at::Tensor& rgb, at::Tensor& gray) {
  const int64_t plane = rgb.size(-2) * rgb.size(-1);
  AT_DISPATCH_FLOATING_TYPES(rgb.scalar_type(), "gray", [&] {
    const scalar_t* const from = rgb.const_data_ptr<scalar_t>();
    scalar_t* const to = gray.mutable_data_ptr<scalar_t>();
    for (int64_t image = 0; image * plane < gray.numel(); ++image) {
      const scalar_t* const red = from + 3 * image * plane;
      at::parallel_for(0, plane, kGrain, [&](int64_t begin, int64_t end) {
        for (int64_t i = begin; i < end; ++i) {
          to[image * plane + i] = luma(red[i], red[plane + i], red[2 * plane + i]);
        }
      });
    }
  });
}

void gray_gradient(const at::Tensor& of_gray, at::Tensor& of_rgb) {
  const int64_t plane = of_rgb.size(-2) * of_rgb.size(-1);
  AT_DISPATCH_FLOATING_TYPES(of_rgb.scalar_type(), "gray_gradient", [&] {
    const scalar_t* const from = of_gray.const_data_ptr<scalar_t>();
    scalar_t* const to = of_rgb.mutable_data_ptr<scalar_t>();
    for (int64_t out = 0; out * plane < of_rgb.numel(); ++out) {
      const scalar_t* const source = from + out / 3 * plane;
      at::parallel_for(0, plane, kGrain, [&](int64_t begin, int64_t end) {
        for (int64_t i = begin; i < end; ++i) {
          to[out * plane + i] = luma_gradient(out % 3, source[i]);
        }
      });
    }
  });
}

}  // namespace jade::imaging::cpu
