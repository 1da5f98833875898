// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/imaging/ssim.h"

namespace jade::losses {

/// ℓ_rec(A, C) = (1 − λ) ‖A − C‖₁ + λ (1 − SSIM(A, C)), Eq. (8): means over all values, SSIM with
/// an 11×11 Gaussian window (σ = 1.5) and zero padding.
/// @param a, c    [C,H,W], C = 3 or 1 (gray). Differentiable in both.
/// @param dssim   λ in [0,1]; `lambda_dssim`, 0.3 in the paper
/// @return scalar
torch::Tensor rec_loss(const torch::Tensor& a, const torch::Tensor& c, double dssim);
torch::Tensor rec_loss(const imaging::L1SsimPair& images, double dssim);

}  // namespace jade::losses
