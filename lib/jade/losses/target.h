// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/imaging/ssim.h"
#include "jade/losses/fixed.h"

namespace jade::losses {

/// L_tgt = ℓ_rec(Î_mid, sg(I)) + ℓ_rec(g(Î_mid), g(sg(I))), Eq. (9).
/// @param mid_render  [3,H,W], Î_mid. Differentiable.
/// @param target      [3,H,W], I_pseudo or any other target
/// @param dssim       λ of Eq. (8)
torch::Tensor target_loss(const torch::Tensor& mid_render, const Fixed& target, double dssim);

/// The images of its two terms, in colour and in gray.
std::vector<imaging::L1SsimPair> target_pairs(const torch::Tensor& mid_render, const Fixed& target);

}  // namespace jade::losses
