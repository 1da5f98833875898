// SPDX-License-Identifier: Apache-2.0
#include "jade/events/voxel.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::events {

EventVoxel normalized(const torch::Tensor& sums) {
  check_shape(sums, "voxel sums", {-1, -1, -1});
  const double largest = sums.numel() > 0 ? sums.abs().max().item<double>() : 0;
  if (largest == 0) return {torch::zeros_like(sums), 0};
  // Divide by a tensor: for a plain number GPUs multiply by the reciprocal, which rounds
  // differently.
  return {sums / torch::full({}, largest, sums.options()), largest};
}

torch::Tensor polarity_projection(const torch::Tensor& voxel) {
  check_shape(voxel, "voxel", {-1, -1, -1});
  return torch::stack({voxel.clamp_min(0).sum(0), voxel.neg().clamp_min(0).sum(0)});
}

torch::Tensor polarity_projection(const torch::Tensor& voxel, double moment) {
  check_shape(voxel, "voxel", {-1, -1, -1});
  JADE_CHECK(moment >= 0 && moment <= 1, "expected a moment from 0 to 1, found ", moment);
  const int64_t bins = voxel.size(0);
  const torch::Tensor before = (moment * static_cast<double>(bins) -
                                torch::arange(bins, torch::TensorOptions(torch::kFloat64)))
                                   .clamp(0, 1);
  const torch::Tensor share = 2 * (before * moment + (1 - before) * (1 - moment));
  return polarity_projection(voxel * share.to(voxel.options()).view({-1, 1, 1}));
}

}  // namespace jade::events
