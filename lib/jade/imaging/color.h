// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::imaging {

/// Weights of red, green and blue in g(·) (ITU-R BT.601 luma).
inline constexpr double kGrayWeights[3] = {0.299, 0.587, 0.114};

/// g(x) = 0.299 R + 0.587 G + 0.114 B: [..., 3, H, W] → [..., 1, H, W], float or double. One pass
/// each for forward and backward; differentiable once.
torch::Tensor gray(const torch::Tensor& rgb);

/// True if red, green and blue of every pixel are bit-equal: [..., 3, H, W].
bool is_gray(const torch::Tensor& rgb);

/// The image with g(·) in all three channels; a gray image is returned unchanged, bit for bit.
torch::Tensor as_gray(const torch::Tensor& rgb);

}  // namespace jade::imaging
