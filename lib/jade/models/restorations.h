// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::models {

/// The two restorations of one view at mid-exposure: constants in θ and φ, computed once.
struct Restorations {
  torch::Tensor edi;    ///< [3,H,W] I_edi = Φ_edi(B, E); may exceed 1
  torch::Tensor efnet;  ///< [3,H,W] F(B, V(E)), in [0,1]
};

/// I_pseudo = α ⊙ I_edi + (1 − α) ⊙ F, Eq. (4).
/// @param alpha  anything that broadcasts to [3,H,W], [1,H,W] as a rule. Differentiable.
/// @return [3,H,W]
torch::Tensor fuse(const torch::Tensor& alpha, const Restorations& restorations);

}  // namespace jade::models
