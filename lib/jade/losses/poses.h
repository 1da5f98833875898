// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::losses {

/// What the objective looks at among an exposure's renders.
struct PoseViews {
  torch::Tensor mean;   ///< [3,H,W], weighted mean over the poses
  torch::Tensor picks;  ///< [M,3,H,W], the renders at the asked poses
};

/// Mean and picks with one gradient pass: the gradient of all nine renders is written once, where
/// separate selections would each allocate and add a batch of all renders.
/// @param renders       [K,3,H,W], differentiable
/// @param pose_indices  [M] int64 on the same device, repeats allowed
/// @param weights       [K] of the mean, of sum 1; undefined: 1/K each
PoseViews pose_views(const torch::Tensor& renders, const torch::Tensor& pose_indices,
                     const torch::Tensor& weights = {});

/// Σ_k w_k renders[k], [K,...] → [...]; the plain mean where `weights` is undefined.
torch::Tensor weighted_mean(const torch::Tensor& renders, const torch::Tensor& weights);

}  // namespace jade::losses
