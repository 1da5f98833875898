// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/events/thresholds.h"
#include "jade/events/voxel.h"

namespace jade::imaging {

/// The event double integral of one exposure, constant for all that is done with the view. With
/// windows w_0 … w_7 between nine times and
///     J_k = −Σ_{j=k..3} w_j (k < 4),  0 (k = 4),  Σ_{j=4..k−1} w_j (k > 4)
/// the blurry frame is B = I_mid · (1/9) Σ_k exp(J_k) and the latent images are I_k = I_mid
/// exp(J_k). One gray increment serves all three channels. Only ratios are kept, computed so that
/// no exponential overflows.
struct EdiKernel {
  /// [9,H,W], what EDI multiplies the blurry frame with: I_k / B = 9 exp(J_k) / Σ_j exp(J_j).
  torch::Tensor gain;
  /// [H,W], what blur multiplies the mid-exposure image with: B / I_mid = (1/9) Σ_j exp(J_j).
  torch::Tensor blur;
};

/// @param windows  [8,H,W], log intensity (events::edi_windows): thresholds are inside.
EdiKernel edi_kernel(const torch::Tensor& windows,
                     events::EdiIndex index = events::EdiIndex::kExact);

/// Φ_edi at mid-exposure, the analytical restoration of Eq. (1). Not clamped, may exceed 1.
/// @param blurry  [3,H,W] or [1,H,W]. Differentiable.
/// @return the shape of `blurry`.
torch::Tensor edi_mid(const torch::Tensor& blurry, const EdiKernel& kernel);

}  // namespace jade::imaging
