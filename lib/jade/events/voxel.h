// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/events/event_stream.h"

namespace jade::events {

/// V(E) of Eq. (1): signed event sums in T equal, half-open bins of an exposure, divided by their
/// largest magnitude. Without events all values are 0, so that K = 1 and EDI returns the frame.
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

/// Ψ for any moment of the exposure, an extension of this library: Eq. (2) has the middle only. An
/// event relates the sharp image of moment u to the other moments s of the blur between which and u
/// it lies. The mean share of such s is (1 − u)/2 for events after u and u/2 for events before it;
/// for the middle both are ¼. So Ψ is split at u and each side is weighted by its share relative to
/// the middle's:
///     Ψ_u = Σ_k ω_k max(±V_k, 0),  ω_k = 2u before u and 2(1 − u) after it.
/// The bin that contains u is divided as if its events were uniform in time. ω = 1 at u = ½ gives
/// the printed Ψ bit for bit. At the ends all events lie on one side, with ω = 2.
/// @param moment  u in [0,1], 0 the start and 1 the end of the exposure.
torch::Tensor polarity_projection(const torch::Tensor& voxel, double moment);

}  // namespace jade::events
