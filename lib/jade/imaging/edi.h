// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/geometry/quadrature.h"

namespace jade::imaging {

/// The event double integral of one exposure, constant for a view. With windows w_0 … w_{S−2}
/// between S equally spaced moments, the middle one m, and
///     J_s = −Σ_{j=s..m−1} w_j (s < m),  0 (s = m),  Σ_{j=m..s−1} w_j (s > m)
/// the blurry frame is B = I_mid · Σ_s q_s exp(J_s), Σ q_s = 1, and the latent images are I_s =
/// I_mid exp(J_s). The printed form has nine moments and q = 1/9. One gray increment serves all
/// three channels. Stores only ratios, computed so that no exponential overflows.
struct EdiKernel {
  /// [S,H,W], log of the factor by which EDI multiplies the blurry frame: ln(I_s / B).
  torch::Tensor log_gain;
  /// [S,H,W], I_s / B = exp(J_s) / Σ_j q_j exp(J_j).
  torch::Tensor gain;
  /// [H,W], factor by which blur multiplies the mid-exposure image: B / I_mid = Σ_j q_j exp(J_j).
  torch::Tensor blur;
};

/// @param windows  [S−1,H,W], log intensity (events::edi_windows), thresholds applied; S odd.
/// @param rule     the weights q, equal or by the trapezoid rule.
EdiKernel edi_kernel(const torch::Tensor& windows,
                     geometry::QuadratureRule rule = geometry::QuadratureRule::kEqual);

/// I(u) / B at any moments, with log intensity interpolated linearly between those of the kernel.
/// @param log_gain  EdiKernel::log_gain
/// @param u         [M] float64 on its device, 0 the start and 1 the end of the exposure. Constant.
/// @return [M,H,W]
torch::Tensor edi_gain(const torch::Tensor& log_gain, const torch::Tensor& u);

/// Φ_edi at mid-exposure, the analytical restoration of Eq. (1). Not clamped, may exceed 1.
/// @param blurry  [3,H,W] or [1,H,W]. Differentiable.
/// @return the shape of `blurry`.
torch::Tensor edi_mid(const torch::Tensor& blurry, const EdiKernel& kernel);

}  // namespace jade::imaging
