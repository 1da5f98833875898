// SPDX-License-Identifier: Apache-2.0
// L_ev, a term of the scene objective from DiET-GS; not in Eq. (10).
#pragma once

#include <torch/types.h>

namespace jade::losses {

/// Two renders and the events between them.
struct EventPair {
  torch::Tensor renders;       ///< [2,3,H,W], ρ(render) at the start and the end of a short window
  torch::Tensor counts;        ///< [H,W], signed event counts in the window (without thresholds)
  torch::Tensor pixels;        ///< [P] int64, sampled pixels: flat indices in [0, H·W), unchecked
  torch::Tensor color_filter;  ///< [H,W,3] bool, the channel of each pixel's events; undefined:
                               ///< gray
  double threshold_positive = 0.2;
  double threshold_negative = 0.2;
  bool weighted_colors = false;  ///< weight R, G, B by 0.4, 0.2, 0.4 (after the warm-up)
};

/// L_ev compares predicted event counts Δℓ/Θ with measured ones at pixels with events. With n the
/// measured count and Θ of n's sign,
///     L_ev = mean_p (Δℓ/Θ − n)² [n > 0] + mean_p (Δℓ/Θ − n)² [n < 0],
/// Δℓ the change of lin_log(255 · luma) (event_loss_math.h), with luma g for gray events, else the
/// pixel's own channel; in colour the sums are divided by the sum of the channel weights instead of
/// P. Differentiable in `renders`, once; float32 on a GPU, with another order of summation.
/// @throws ContractError for shapes, types and devices that do not match.
torch::Tensor event_loss(const EventPair& events);

}  // namespace jade::losses
