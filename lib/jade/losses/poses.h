// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

namespace jade::losses {

/// Images that the objective reads from an exposure's renders.
struct PoseViews {
  torch::Tensor mean;                ///< [3,H,W], weighted mean over the poses
  std::vector<torch::Tensor> picks;  ///< [3,H,W] each, the renders at the asked poses
  torch::Tensor all;                 ///< [K,3,H,W], the renders themselves
};

/// Mean and picks with one pass each way: the gradient of all nine renders is written once, where
/// separate selections would each allocate and add a batch of all renders. Who reads every render
/// besides reads `all`, whose gradient joins in that pass.
/// @param renders       [K,3,H,W], differentiable
/// @param pose_indices  [M] int64 on the same device, repeats allowed
/// @param weights       [K] of the mean, of sum 1; undefined: 1/K each
/// @param first         a pick before those of the indices; below 0: none. At most 8 in all on a
/// GPU.
PoseViews pose_views(const torch::Tensor& renders, const torch::Tensor& pose_indices,
                     const torch::Tensor& weights = {}, int64_t first = -1);

/// Σ_k w_k renders[k], [K,...] → [...]; the plain mean where `weights` is undefined.
torch::Tensor weighted_mean(const torch::Tensor& renders, const torch::Tensor& weights);

}  // namespace jade::losses
