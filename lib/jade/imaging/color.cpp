// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/color.h"

#include <torch/csrc/autograd/custom_function.h>
#include <torch/types.h>
#include <vector>

#include "jade/core/check.h"
#include "jade/imaging/color_kernels.h"
#include "jade/kernel/on_cuda.h"

namespace jade::imaging {

namespace {

static_assert(kGrayWeights[0] == kLumaRed && kGrayWeights[1] == kLumaGreen &&
              kGrayWeights[2] == kLumaBlue);

std::vector<int64_t> with_channels(const torch::Tensor& image, int64_t channels) {
  std::vector<int64_t> shape = image.sizes().vec();
  shape[shape.size() - 3] = channels;
  return shape;
}

struct Gray : torch::autograd::Function<Gray> {
  static torch::Tensor forward(torch::autograd::AutogradContext*, const torch::Tensor& rgb) {
    const torch::Tensor from = rgb.contiguous();
    torch::Tensor out = torch::empty(with_channels(from, 1), from.options().requires_grad(false));
    if (from.is_cuda()) {
      kernel::on_cuda("an image in gray", [&] { cuda::gray(from, out); });
    } else {
      cpu::gray(from, out);
    }
    return out;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext*,
                                                 const torch::autograd::variable_list& gradients) {
    const torch::Tensor from = gradients[0].contiguous();
    torch::Tensor out = torch::empty(with_channels(from, 3), from.options());
    if (from.is_cuda()) {
      kernel::on_cuda("an image in gray", [&] { cuda::gray_gradient(from, out); });
    } else {
      cpu::gray_gradient(from, out);
    }
    return {out};
  }
};

}  // namespace

torch::Tensor gray(const torch::Tensor& rgb) {
  JADE_CHECK(rgb.defined() && rgb.dim() >= 3 && rgb.size(-3) == 3,
             "gray: expected [..., 3, H, W], found ", shape_string(rgb));
  JADE_CHECK(rgb.scalar_type() == torch::kFloat32 || rgb.scalar_type() == torch::kFloat64,
             "gray: expected a float or double image, found ", rgb.scalar_type());
  return Gray::apply(rgb);
}

bool is_gray(const torch::Tensor& rgb) {
  JADE_CHECK(rgb.defined() && rgb.dim() >= 3 && rgb.size(-3) == 3,
             "is_gray: expected [..., 3, H, W], found ", shape_string(rgb));
  const torch::Tensor red = rgb.select(-3, 0);
  return red.equal(rgb.select(-3, 1)) && red.equal(rgb.select(-3, 2));
}

torch::Tensor as_gray(const torch::Tensor& rgb) {
  // The weighted sum of three equal numbers can differ in the last bit.
  return is_gray(rgb) ? rgb : gray(rgb).expand_as(rgb).contiguous();
}

}  // namespace jade::imaging
