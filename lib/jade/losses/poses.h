// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

namespace jade::losses {

/// Images that the objective reads from an exposure's renders.
struct PoseViews {
  torch::Tensor mean;                ///< [3,H,W], weighted mean over the poses
  std::vector<torch::Tensor> picks;  ///< [3,H,W] each, the renders at the requested poses
  torch::Tensor all;                 ///< [K,3,H,W], the renders themselves
};

/// Mean and picks in one forward and one backward pass: the gradient of all renders is written
/// once, whereas separate selections would each allocate and add a batch of all renders. Callers
/// that also read every render must use `all`, whose gradient is added in that pass.
/// @param renders       [K,3,H,W], differentiable
/// @param pose_indices  [M] int64 on the same device, repeats allowed
/// @param weights       [K] of the mean, of sum 1; undefined: 1/K each
/// @param first         an additional pick before those; negative: none. At most 8 in total on a
///   GPU.
PoseViews pose_views(const torch::Tensor& renders, const torch::Tensor& pose_indices,
                     const torch::Tensor& weights = {}, int64_t first = -1);

/// Σ_k w_k renders[k], [K,...] → [...]; the plain mean if `weights` is undefined.
torch::Tensor weighted_mean(const torch::Tensor& renders, const torch::Tensor& weights);

}  // namespace jade::losses
