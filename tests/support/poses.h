// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/data/exposure.h"

namespace jade::test {

/// The largest magnitude in a tensor.
inline double largest(const torch::Tensor& t) { return t.abs().max().item<double>(); }

/// The k-th pose of an exposure, [4,4] float32.
inline torch::Tensor pose_of(const data::Exposure& exposure, size_t k) {
  return geometry::to_tensor(exposure.poses[k]).to(torch::kFloat32);
}

}  // namespace jade::test
