// SPDX-License-Identifier: Apache-2.0
#include "jade/events/voxel.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::events {

EventVoxel normalized(const torch::Tensor& sums) {
  check_shape(sums, "voxel sums", {-1, -1, -1});
  const double largest = sums.numel() > 0 ? sums.abs().max().item<double>() : 0;
  if (largest == 0) return {torch::zeros_like(sums), 0};
  // By a tensor: GPUs multiply with the reciprocal of a plain number, which rounds otherwise.
  return {sums / torch::full({}, largest, sums.options()), largest};
}

torch::Tensor polarity_projection(const torch::Tensor& voxel) {
  check_shape(voxel, "voxel", {-1, -1, -1});
  return torch::stack({voxel.clamp_min(0).sum(0), voxel.neg().clamp_min(0).sum(0)});
}

}  // namespace jade::events
