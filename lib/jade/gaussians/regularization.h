// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::gaussians {

/// opacity_weight · mean σ(logit_opacities) + scale_weight · mean exp(log_scales), which MCMC adds
/// to the loss so that unneeded Gaussians fade and shrink (arXiv 2404.09591).
/// Scalar, of the inputs' type; differentiable in both inputs.
torch::Tensor mean_opacity_and_scale(const torch::Tensor& logit_opacities,
                                     const torch::Tensor& log_scales, double opacity_weight,
                                     double scale_weight);

}  // namespace jade::gaussians
