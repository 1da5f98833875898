// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::losses {

/// What the objective looks at among the nine renders.
struct PoseViews {
  torch::Tensor mean;   ///< [3,H,W], mean over the poses
  torch::Tensor picks;  ///< [M,3,H,W], the renders at the asked poses
};

/// Mean and picks with one gradient pass: the gradient of all nine renders is written once, where
/// separate selections would each allocate and add a batch of nine.
/// @param renders       [K,3,H,W], differentiable
/// @param pose_indices  [M] int64 on the same device, repeats allowed
PoseViews pose_views(const torch::Tensor& renders, const torch::Tensor& pose_indices);

}  // namespace jade::losses
