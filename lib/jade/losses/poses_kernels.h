// SPDX-License-Identifier: Apache-2.0
// pose_views() without autograd. Private to this folder.
#pragma once

#include <ATen/core/Tensor.h>
#include <cstdint>
#include <vector>

namespace jade::losses {

/// Maximum number of picks per call on a GPU, where they are a kernel argument.
constexpr int kMostPicks = 8;

/// Which renders to pick, and the weights of their mean.
struct PosePicks {
  at::Tensor indices;  ///< [M] int64
  int64_t first = -1;  ///< an additional pick before those of the indices; negative: none
  at::Tensor weights;  ///< [K] of the renders' type; undefined: 1/K each

  int64_t count() const { return indices.numel() + (first >= 0 ? 1 : 0); }
};

/// Gradients of the outputs of pose_views().
struct PoseGradients {
  at::Tensor mean;                ///< [...]
  std::vector<at::Tensor> picks;  ///< count() of them
  at::Tensor all;                 ///< [K,...]
};

/// The gradient of all renders, [K,...] contiguous, written once.
/// @param of    contiguous gradients; undefined: none
namespace cpu {  // float or double
/// Σ weights[k] renders[k] in that order. @param renders  [K,...] contiguous
void weighted_sum(const at::Tensor& renders, const at::Tensor& weights, at::Tensor& sum);
void pose_gradient(const PosePicks& picks, const PoseGradients& of, at::Tensor& of_renders);
}  // namespace cpu

namespace cuda {  // float; runs on the current stream without waiting
/// @param renders  [K,...] contiguous
void pose_views(const PosePicks& picks, const at::Tensor& renders, at::Tensor& mean,
                std::vector<at::Tensor>& picked);
void pose_gradient(const PosePicks& picks, const PoseGradients& of, at::Tensor& of_renders);
}  // namespace cuda

}  // namespace jade::losses
