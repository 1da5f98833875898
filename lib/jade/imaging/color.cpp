// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/color.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::imaging {

torch::Tensor gray(const torch::Tensor& rgb) {
  JADE_CHECK(rgb.defined() && rgb.dim() >= 3 && rgb.size(-3) == 3,
             "gray: expected [..., 3, H, W], found ", shape_string(rgb));
  // Products of narrowed channels: a matmul over a size of 3 would be slower and round differently.
  return rgb.narrow(-3, 0, 1) * kGrayWeights[0] + rgb.narrow(-3, 1, 1) * kGrayWeights[1] +
         rgb.narrow(-3, 2, 1) * kGrayWeights[2];
}

bool is_gray(const torch::Tensor& rgb) {
  JADE_CHECK(rgb.defined() && rgb.dim() >= 3 && rgb.size(-3) == 3,
             "is_gray: expected [..., 3, H, W], found ", shape_string(rgb));
  const torch::Tensor red = rgb.select(-3, 0);
  return red.equal(rgb.select(-3, 1)) && red.equal(rgb.select(-3, 2));
}

torch::Tensor as_gray(const torch::Tensor& rgb) {
  // The weights' sum of three equal numbers is another number in the last bit.
  return is_gray(rgb) ? rgb : gray(rgb).expand_as(rgb).contiguous();
}

}  // namespace jade::imaging
