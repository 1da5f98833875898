// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::gaussians {

/// Order of points along a Z-curve, so that consecutive points are near in space: [N] int64, for
/// index_select. Deterministic. Improves the compression of files of Gaussians.
/// @param points  [N,3], finite
torch::Tensor spatial_order(const torch::Tensor& points);

}  // namespace jade::gaussians
