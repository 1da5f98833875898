// SPDX-License-Identifier: Apache-2.0
// Image metrics, each by its true name. Images are [3,H,W] RGB in [0,1]; values outside are
// clamped, as a screen would.
#pragma once

#include <torch/types.h>

namespace jade::eval {

/// −10 log10 of the mean squared error over all pixels and channels, dB. 100 for equal images.
double psnr(const torch::Tensor& image, const torch::Tensor& truth);

/// Mean of the three channels' PSNRs, dB: what the published tables of this field hold.
double psnr_channel_mean(const torch::Tensor& image, const torch::Tensor& truth);

/// SSIM with an 11×11 Gaussian window (σ = 1.5) and zero padding, mean over pixels and channels.
double ssim(const torch::Tensor& image, const torch::Tensor& truth);

}  // namespace jade::eval
