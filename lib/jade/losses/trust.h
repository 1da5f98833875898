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
  double agreement = 0;
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
          "weight, is below this; 0: at none",
          Range{0, 10});
  v.field("from", o.from, "scale and tolerance act after this step", Range{0, 1e9});
}

/// What the render is drawn to instead of `target`: sg(render) + w (target − sg(render)), per
/// pixel,
///     w = sg(c / (c + mean over a 5×5 window and channels of |target − render|)).
/// Against it L1 has w times its gradient, and where w falls to 0 the target abstains.
/// @param target  [C,H,W], differentiable
/// @param render  [C,H,W], no gradient. Windows end at the border.
torch::Tensor trusted(const torch::Tensor& target, const Fixed& render, double scale);

/// The point of [target · exp(−band), target · exp(band)] that is nearest to the render: against it
/// a render inside the band has no loss and no gradient.
/// @param target  [C,H,W], differentiable
/// @param render  [C,H,W], no gradient
torch::Tensor within_band(const torch::Tensor& target, const Fixed& render, double band);

/// The value where it is below `bound`, else 0 without a gradient: a restoration that all other
/// views and terms contradict keeps away from the scene, one that they have come to agree with
/// stays. Once away a view seldom comes back, as nothing draws its render to the restoration.
/// @param value  scalar, L_tgt of a view
torch::Tensor where_agreed(const torch::Tensor& value, double bound);

/// Scale and tolerance as far as the options ask for them, the band first.
/// @param contrast  log intensity of one event; 0: no band
torch::Tensor followed(const torch::Tensor& target, const torch::Tensor& render,
                       const TrustOptions& options, double contrast);

}  // namespace jade::losses
