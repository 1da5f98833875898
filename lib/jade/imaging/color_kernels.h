// SPDX-License-Identifier: Apache-2.0
// g(·) without autograd. Private to this folder.
#pragma once

#include <ATen/core/Tensor.h>

#include "jade/imaging/luma.h"

namespace jade::imaging {

// float or double, contiguous; `rgb` is [..., 3, H, W] and `gray` [..., 1, H, W].
namespace cpu {
void gray(const at::Tensor& rgb, at::Tensor& gray);
void gray_gradient(const at::Tensor& of_gray, at::Tensor& of_rgb);
}  // namespace cpu

namespace cuda {  // runs on the current stream without waiting
void gray(const at::Tensor& rgb, at::Tensor& gray);
void gray_gradient(const at::Tensor& of_gray, at::Tensor& of_rgb);
}  // namespace cuda

}  // namespace jade::imaging
