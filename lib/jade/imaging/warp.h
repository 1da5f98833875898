// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::imaging {

/// Resamples an image through a map: pixel (i, j) of the result is the image at column map[0,i,j]
/// and row map[1,i,j], bicubic, clamped to [0,1]. Up to one pixel outside the image, its nearest
/// edge is used; farther out, and where the map is NaN, the result is black.
/// @param image  [C,H,W] float32 on the CPU, C 1 or 3
/// @param map    [2,h,w] float32, pixel indices (geometry/rectification.h)
/// @return [C,h,w]
torch::Tensor remap(const torch::Tensor& image, const torch::Tensor& map);

/// Marks the pixels of remap()'s result that depend on counted pixels only.
/// @param mask  [1,H,W] bool on the CPU, true: the pixel counts
/// @param map   as in remap(); pixels outside the image do not count
/// @return [1,h,w] bool
torch::Tensor remap_mask(const torch::Tensor& mask, const torch::Tensor& map);

}  // namespace jade::imaging
