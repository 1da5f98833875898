// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/events/event_stream.h"

namespace jade::events {

/// V(E) of Eq. (1): signed event sums in T equal, half-open bins of an exposure, divided by their
/// largest magnitude. Without events everything is 0, so that K = 1 and EDI returns the frame.
struct EventVoxel {
  torch::Tensor values;  ///< [T,H,W] float32, max |V| = 1 or all 0
  double v_max = 0;      ///< the divisor, in events; values · v_max are event sums

  int64_t bins() const { return values.size(0); }
};

/// Divides [T,H,W] signed sums by their largest magnitude.
EventVoxel normalized(const torch::Tensor& sums);

/// Ψ, the polarity-signed temporal projection of Eq. (2): Σ_k max(V_k, 0) and Σ_k max(−V_k, 0).
/// @param voxel  [T,H,W] of any floating type.
/// @return [2,H,W]
torch::Tensor polarity_projection(const torch::Tensor& voxel);

}  // namespace jade::events
