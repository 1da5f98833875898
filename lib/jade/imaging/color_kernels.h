// SPDX-License-Identifier: Apache-2.0
// g(·) apart from autograd. Not for use outside this room.
#pragma once

#include <ATen/core/Tensor.h>
#include <cstdint>

#include "jade/kernel/host_device.h"

namespace jade::imaging {

/// kGrayWeights, for device code.
constexpr double kLumaRed = 0.299, kLumaGreen = 0.587, kLumaBlue = 0.114;

template <class T>
JADE_HD T luma(T red, T green, T blue) {
  return red * T(kLumaRed) + green * T(kLumaGreen) + blue * T(kLumaBlue);
}

/// Of luma() in channel `c`, from the gradient of its value.
template <class T>
JADE_HD T luma_gradient(int64_t c, T gradient) {
  return gradient * (c == 0 ? T(kLumaRed) : c == 1 ? T(kLumaGreen) : T(kLumaBlue));
}

// float or double, contiguous; `rgb` is [..., 3, H, W] and `gray` [..., 1, H, W].
namespace cpu {
void gray(const at::Tensor& rgb, at::Tensor& gray);
void gray_gradient(const at::Tensor& of_gray, at::Tensor& of_rgb);
}  // namespace cpu

namespace cuda {  // on the current stream; no waiting
void gray(const at::Tensor& rgb, at::Tensor& gray);
void gray_gradient(const at::Tensor& of_gray, at::Tensor& of_rgb);
}  // namespace cuda

}  // namespace jade::imaging
