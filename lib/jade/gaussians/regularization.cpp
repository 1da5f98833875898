// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/regularization.h"

#include <torch/types.h>

namespace jade::gaussians {

torch::Tensor mean_opacity_and_scale(const torch::Tensor& logit_opacities,
                                     const torch::Tensor& log_scales, double opacity_weight,
                                     double scale_weight) {
  return opacity_weight * logit_opacities.sigmoid().mean() + scale_weight * log_scales.exp().mean();
}

}  // namespace jade::gaussians
