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

/// Ψ about any moment of the exposure, an extension of ours: Eq. (2) has the middle only. An event
/// tells about the sharp image of moment u by relating it to other moments s of the blur, those for
/// which it lies between u and s. The mean share of such s is (1 − u)/2 for events after u and u/2
/// for events before it, in the middle ¼ for both. So Ψ is split at u and each side counts with its
/// share relative to the middle's:
///     Ψ_u = Σ_k ω_k max(±V_k, 0),  ω_k = 2u before u and 2(1 − u) after it,
/// and the bin that u lies in is divided as if its events came evenly. ω = 1 at u = ½: the printed
/// Ψ, to the last bit. At the ends all events lie on one side, reach twice as far and count twice.
/// @param moment  u in [0,1], 0 the start and 1 the end of the exposure.
torch::Tensor polarity_projection(const torch::Tensor& voxel, double moment);

}  // namespace jade::events
