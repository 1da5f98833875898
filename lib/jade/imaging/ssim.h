// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

namespace jade::imaging {

// Structural similarity as in 3D Gaussian splatting papers: an 11x11 Gaussian window with σ = 1.5,
// zero padding of 5, biased variances E[x²] − μ², C1 = 0.01², C2 = 0.03² for values in [0,1], the
// mean over all pixels and channels. Images are [C,H,W] or [N,C,H,W] of any size from 1x1, float or
// double on the CPU and float on CUDA. Forward and gradient are one fused pass that stores a single
// map per argument; the gradient is not differentiable. Any number of threads gives the same bits.

/// A constant image with its window means, which are two of the five that SSIM needs: compute them
/// once to compare many images with it. Never receives a gradient.
struct SsimTarget {
  torch::Tensor image;
  torch::Tensor mean;    ///< window mean of the image
  torch::Tensor square;  ///< window mean of its square
};

SsimTarget ssim_target(const torch::Tensor& image);

/// Mean SSIM, a scalar. Differentiable in both images; only required gradients are computed.
torch::Tensor ssim(const torch::Tensor& a, const torch::Tensor& b);
torch::Tensor ssim(const torch::Tensor& a, const SsimTarget& b);

/// SSIM at each pixel and channel, float64 in the shape of the images; ssim() is its mean. Plain
/// operations of torch, for scores of masked images. Differentiable.
torch::Tensor ssim_map(const torch::Tensor& a, const torch::Tensor& b);

/// D(A, C) = (1 − λ) mean|A − C| + λ (1 − SSIM(A, C)), Eq. (8), in the same single pass. The
/// derivative of |x| at 0 is taken as 0. Differentiable in both images.
torch::Tensor l1_ssim(const torch::Tensor& a, const torch::Tensor& c, double lambda);
torch::Tensor l1_ssim(const torch::Tensor& a, const SsimTarget& c, double lambda);

/// D of two images as part of a sum. A second image without window means receives a gradient.
struct L1SsimPair {
  torch::Tensor a;
  SsimTarget c;
};

/// weight · scale · (D of the first pair + D of the second + …).
struct L1SsimTerm {
  std::vector<L1SsimPair> pairs;
  double weight = 1;
  torch::Tensor scale;  ///< [] on the images' device, constant; undefined: 1
};

struct L1SsimSum {
  torch::Tensor total;  ///< scalar
  torch::Tensor terms;  ///< [T]
};

/// A sum of terms, all images in one pass. All images have the same height and width; at most 16
/// pairs in total on a GPU. Differentiable in both images of each pair, through either output.
L1SsimSum l1_ssim_sum(const std::vector<L1SsimTerm>& terms, double lambda);

}  // namespace jade::imaging
