// SPDX-License-Identifier: Apache-2.0
// mean_opacity_and_scale() without autograd. Private to this folder.
#pragma once

#include <ATen/core/Tensor.h>

#include "jade/kernel/host_device.h"

namespace jade::gaussians {

/// Contiguous inputs.
struct Regularized {
  at::Tensor logit_opacities, log_scales;
  double opacity_weight = 0, scale_weight = 0;
};

JADE_HD float opacity_of(float logit) { return 1 / (1 + kernel::exp(-logit)); }
JADE_HD float opacity_slope(float logit) {
  const float opacity = opacity_of(logit);
  return opacity * (1 - opacity);
}

namespace cuda {  // float; runs on the current stream without waiting, deterministic
/// @param value  [], written
void regularization(const Regularized& in, at::Tensor& value);
/// @param of_value  []
/// @param of_logits, of_log_scales  as the inputs, written
void regularization_gradient(const Regularized& in, const at::Tensor& of_value,
                             at::Tensor& of_logits, at::Tensor& of_log_scales);
}  // namespace cuda

}  // namespace jade::gaussians
