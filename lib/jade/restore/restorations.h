// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::restore {

/// The two restorations of one view at mid-exposure: constants in θ and φ, computed once.
struct Restorations {
  torch::Tensor edi;    ///< [3,H,W] I_edi = Φ_edi(B, E); may exceed 1
  torch::Tensor efnet;  ///< [3,H,W] F(B, V(E)), in [0,1]
};

/// I_pseudo = α ⊙ I_edi + (1 − α) ⊙ F, Eq. (4).
/// @param alpha  anything that broadcasts to [3,H,W], [1,H,W] as a rule. Differentiable.
/// @return [3,H,W]
torch::Tensor fuse(const torch::Tensor& alpha, const Restorations& restorations);

/// The gray image nearest to `image`, the mean of its channels in all three: what a restorer for
/// colours makes of a gray frame, without the tint. Of all grays this one is never farther from a
/// gray truth, in squared error, than the tinted image itself.
/// @param image  [3,H,W] or [K,3,H,W]
torch::Tensor without_tint(const torch::Tensor& image);

}  // namespace jade::restore
