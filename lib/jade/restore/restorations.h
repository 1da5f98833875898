// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::restore {

/// The two restorations of one view at mid-exposure: constant with respect to θ and φ, computed
/// once.
struct Restorations {
  torch::Tensor edi;    ///< [3,H,W] I_edi = Φ_edi(B, E); may exceed 1
  torch::Tensor efnet;  ///< [3,H,W] F(B, V(E)), in [0,1]
};

/// I_pseudo = α ⊙ I_edi + (1 − α) ⊙ F, Eq. (4).
/// @param alpha  broadcasts to [3,H,W], usually [1,H,W]. Differentiable.
/// @return [3,H,W]
torch::Tensor fuse(const torch::Tensor& alpha, const Restorations& restorations);

/// The gray image nearest to `image`, with the mean of its channels in all three: removes the tint
/// that a colour restorer adds to a gray frame. In squared error it is never farther from a gray
/// truth than the tinted image.
/// @param image  [3,H,W] or [K,3,H,W]
torch::Tensor without_tint(const torch::Tensor& image);

}  // namespace jade::restore
