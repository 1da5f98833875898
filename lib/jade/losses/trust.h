// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/core/fields.h"

namespace jade::losses {

/// When to trust restorations, which are wrong where events are missing, noisy or coarse, while the
/// scene combines several exposures; the configuration group `objective.trust`.
struct TrustOptions {
  double agreement = 0.05;
};

template <class V>
void describe(V& v, TrustOptions& o) {
  v.field("agreement", o.agreement,
          "after objective.target_until, L_tgt stays on for views whose L_tgt before its weight is "
          "below this; 0: for none; logged in metrics.jsonl as target_distance",
          Range{0, 10});
}

/// The value if it is below `bound`, else 0 without gradient: a restoration that all other views
/// and terms contradict does not affect the scene, one that they agree with does. A view that
/// exceeds the bound seldom falls below it again, because nothing pulls its render to the
/// restoration.
/// @param value  scalar, L_tgt of a view before its weight
torch::Tensor where_agreed(const torch::Tensor& value, double bound);

}  // namespace jade::losses
