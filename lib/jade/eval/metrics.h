// SPDX-License-Identifier: Apache-2.0
// Image metrics. Images are [3,H,W] RGB in [0,1]; values outside are clamped, as on a screen. A
// mask, [1,H,W] bool on any device, is true for pixels that count; undefined: all pixels count.
#pragma once

#include <torch/types.h>

namespace jade::eval {

/// −10 log10 of the mean squared error over all pixels that count and channels, dB. 100 for equal
/// images.
double psnr(const torch::Tensor& image, const torch::Tensor& truth, const torch::Tensor& mask = {});

/// Mean of the three channels' PSNRs, dB, as in the field's published tables.
double psnr_channel_mean(const torch::Tensor& image, const torch::Tensor& truth,
                         const torch::Tensor& mask = {});

/// SSIM with an 11×11 Gaussian window (σ = 1.5) and zero padding, mean over the pixels that count
/// and channels. Windows see excluded pixels as 0 in both images.
double ssim(const torch::Tensor& image, const torch::Tensor& truth, const torch::Tensor& mask = {});

/// The image with excluded pixels set to 0; the same tensor if all pixels count.
torch::Tensor only_counted(const torch::Tensor& image, const torch::Tensor& mask);

}  // namespace jade::eval
