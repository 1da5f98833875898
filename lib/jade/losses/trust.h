// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/core/fields.h"
#include "jade/core/steps.h"
#include "jade/losses/fixed.h"

namespace jade::losses {

/// Restorations are wrong where events are missing, noisy or coarse, and the scene, which has seen
/// the same point from other exposures, may know better; the configuration group
/// `objective.trust`.
struct TrustOptions {
  double scale = 0;
  double tolerance = 0;
  double agreement = 0.05;
  double disagreement = 0;
  Steps from = Steps::share(8);
};

template <class V>
void describe(V& v, TrustOptions& o) {
  v.field("scale", o.scale,
          "c of the weight c / (c + 5x5 mean of |target - render|) on L_tgt and L_edi, in "
          "intensity; 0: they count in full",
          Range{0, 10});
  v.field("tolerance", o.tolerance,
          "differences in log intensity up to this many contrast thresholds do not count in L_edi",
          Range{0, 10});
  v.field("agreement", o.agreement,
          "after objective.target_until the target stays at the views where L_tgt, before its "
          "weight and scale, is below this; 0: at none; metrics.jsonl has it as target_distance",
          Range{0, 10});
  v.field("disagreement", o.disagreement,
          "c of the weight c / (c + 5x5 mean of |EFNet - EDI|) on L_tgt, in intensity, at every "
          "step; 0: it counts in full",
          Range{0, 10});
  v.field("from", o.from, "scale and tolerance act after this step", Range{0, 1e9});
}

/// How far two images are to be taken for the same, [1,H,W] in (0, 1], without a gradient:
///     w = c / (c + mean over a 5×5 window and channels of |a − b|).
/// Windows end at the border.
/// @param a, b   [C,H,W]
/// @param scale  c, in intensity
torch::Tensor closeness(const torch::Tensor& a, const torch::Tensor& b, double scale);

/// What the render is drawn to instead of `target`: sg(render) + w (target − sg(render)). Against
/// it L1 has w times its gradient, and where w falls to 0 the target abstains.
/// @param target  [C,H,W], differentiable
/// @param render  [C,H,W], no gradient
/// @param weight  [1,H,W], w
torch::Tensor drawn_by(const torch::Tensor& target, const Fixed& render,
                       const torch::Tensor& weight);

/// The same with w the closeness of target and render.
torch::Tensor trusted(const torch::Tensor& target, const Fixed& render, double scale);

/// The point of [target · exp(−band), target · exp(band)] that is nearest to the render: against it
/// a render inside the band has no loss and no gradient.
/// @param target  [C,H,W], differentiable
/// @param render  [C,H,W], no gradient
torch::Tensor within_band(const torch::Tensor& target, const Fixed& render, double band);

/// The value where `distance` is below `bound`, else 0 without a gradient: a restoration that all
/// other views and terms contradict keeps away from the scene, one that they have come to agree
/// with stays. Once away a view seldom comes back, as nothing draws its render to the restoration.
/// @param value     scalar, L_tgt of a view
/// @param distance  scalar, L_tgt of that view against the whole of its target
torch::Tensor where_agreed(const torch::Tensor& value, const torch::Tensor& distance, double bound);

/// Scale and tolerance as far as the options ask for them, the band first.
/// @param contrast  log intensity of one event; 0: no band
torch::Tensor followed(const torch::Tensor& target, const torch::Tensor& render,
                       const TrustOptions& options, double contrast);

}  // namespace jade::losses
