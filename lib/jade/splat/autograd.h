// SPDX-License-Identifier: Apache-2.0
// The op as a node of torch's graph. Saves tensors and calls the backend; contains no arithmetic.
#pragma once

#include <torch/types.h>

#include "jade/splat/backend.h"

namespace jade::splat {

struct BlendedImages {
  torch::Tensor color, alpha, depth_sum, rejected;
};

/// Differentiable in the Gaussians, the background and `camera_from_world` of `args`, whose tensors
/// may require gradients here. Sets `needs_backward` itself.
BlendedImages blend_images(const ForwardArgs& args, const ScreenStatistics& statistics,
                           int64_t statistics_views);

}  // namespace jade::splat
