// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::gaussians {

/// Order of points along a Z-curve, so that neighbours in it are near in space: [N] int64, for
/// index_select. The same for the same points. Files of Gaussians pack better in it.
/// @param points  [N,3], finite
torch::Tensor spatial_order(const torch::Tensor& points);

}  // namespace jade::gaussians
