// SPDX-License-Identifier: Apache-2.0
// Terms of the scene objective: L_tgt of Eq. (9) and those inherited from DiET-GS. D is ℓ_rec of
// Eq. (8), imaging::l1_ssim(), with its weight `dssim`, g is imaging::gray, ρ the camera response,
// Î_k the render at pose k and B the blurry frame. EDI is linear in the image, EDI_k(X) = X ⊙ R_k
// with the factor R_k = edi_gain() of imaging/edi.h, so the functions take R_k. Functions for
// D(·,·) return the two images to compare; imaging::l1_ssim_sum() evaluates all pairs of a step in
// one pass.
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/imaging/ssim.h"
#include "jade/losses/fixed.h"

namespace jade::losses {

/// L_tgt = D(Î_mid, sg(I)) + D(g(Î_mid), g(sg(I))), Eq. (9).
/// @param mid_render  [3,H,W], Î_mid. Differentiable.
/// @param target      [3,H,W], I_pseudo or any other target
torch::Tensor target_loss(const torch::Tensor& mid_render, const Fixed& target, double dssim);

/// The images of its two terms, in colour and in gray.
std::vector<imaging::L1SsimPair> target_pairs(const torch::Tensor& mid_render, const Fixed& target);

/// The value if it is below `bound`, else 0 without gradient: a restoration that all other views
/// and terms contradict does not affect the scene, one that they agree with does. A view that
/// exceeds the bound seldom falls below it again, because nothing pulls its render to the
/// restoration.
/// @param value  scalar, L_tgt of a view before its weight
torch::Tensor where_agreed(const torch::Tensor& value, double bound);

/// L_blur = D(mean_k Î_k, B).
/// @param mean_render  [3,H,W], differentiable
/// @param blurry       [3,H,W], with its window means if they are stored
imaging::L1SsimPair blur_pair(const torch::Tensor& mean_render, const imaging::SsimTarget& blurry);

/// L_edi in gray = D(g(ρ(Î_k)), EDI_k(g(ρ(B)))).
/// @param toned_render, toned_blurry  [3,H,W], ρ(Î_k) and ρ(B), or [1,H,W], g of them;
///                                    differentiable in both
/// @param edi_factor                  [1,H,W], R_k
imaging::L1SsimPair edi_gray_pair(const torch::Tensor& toned_render,
                                  const torch::Tensor& toned_blurry,
                                  const torch::Tensor& edi_factor);

/// L_edi in colour = D(Î_k, EDI_k(B)), without ρ.
/// @param render, blurry  [3,H,W]; differentiable in `render`
imaging::L1SsimPair edi_color_pair(const torch::Tensor& render, const torch::Tensor& blurry,
                                   const torch::Tensor& edi_factor);

/// L_sim = D(g(ρ(Î_k)), EDI_k(g(ρ(mean_j Î_j)))): the EDI of the simulated blur. Gradients flow
/// through both images.
/// @param toned_render, toned_mean  [3,H,W], or [1,H,W], g of them
imaging::L1SsimPair simulation_pair(const torch::Tensor& toned_render,
                                    const torch::Tensor& toned_mean,
                                    const torch::Tensor& edi_factor);

/// L_int = D(mean_k ρ(Î_k), ρ(B)); ρ is applied before the mean, unlike in L_sim.
imaging::L1SsimPair intensity_pair(const torch::Tensor& mean_toned,
                                   const torch::Tensor& toned_blurry);

}  // namespace jade::losses
