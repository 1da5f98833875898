// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/geometry/quadrature.h"

namespace jade::imaging {

/// The event double integral of one exposure, Eq. (1), constant for a view. With windows w_0 …
/// w_{S−2} between S equally spaced moments, the middle one m, and
///     J_s = −Σ_{j=s..m−1} w_j (s < m),  0 (s = m),  Σ_{j=m..s−1} w_j (s > m)
/// the blurry frame is B = I_mid · Σ_s q_s exp(J_s), Σ q_s = 1, and the latent images are I_s =
/// I_mid exp(J_s). The printed form has nine moments and q = 1/9. One gray increment serves all
/// three channels. No exponential overflows. Works on some pixels at a time, so that it needs
/// little memory beyond windows and result. Not differentiable.
/// @param windows   [S−1,H,W], log intensity (events::edi_windows), thresholds applied; S odd.
/// @param rule      the weights q, equal or by the trapezoid rule.
/// @param u         [M] float64 on the device of the windows: moments, 0 the start and 1 the end of
///   the exposure. Between the S moments log intensity is linear.
/// @param contrast  multiplies the windows.
/// @return [M,H,W], I(u) / B = exp(J(u)) / Σ_j q_j exp(J_j).
torch::Tensor edi_gain(const torch::Tensor& windows, geometry::QuadratureRule rule,
                       const torch::Tensor& u, double contrast = 1);

}  // namespace jade::imaging
