// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/trust.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::losses {

torch::Tensor closeness(const torch::Tensor& a, const torch::Tensor& b, double scale) {
  check_shape(a, "image", b.sizes().vec());
  const torch::Tensor local =
      torch::avg_pool2d((a - b).detach().abs().mean(0, /*keepdim=*/true), 5, 1, 2,
                        /*ceil_mode=*/false, /*count_include_pad=*/false);
  return scale / (local + scale);
}

torch::Tensor drawn_by(const torch::Tensor& target, const Fixed& render,
                       const torch::Tensor& weight) {
  check_shape(target, "target", render->sizes().vec());
  return torch::addcmul(*render, target - *render, weight);
}

torch::Tensor trusted(const torch::Tensor& target, const Fixed& render, double scale) {
  return drawn_by(target, render, closeness(target, *render, scale));
}

torch::Tensor within_band(const torch::Tensor& target, const Fixed& render, double band) {
  check_shape(target, "target", render->sizes().vec());
  return torch::max(torch::min(*render, target * std::exp(band)), target * std::exp(-band));
}

torch::Tensor where_agreed(const torch::Tensor& value, const torch::Tensor& distance,
                           double bound) {
  return value * distance.detach().lt(bound);
}

torch::Tensor followed(const torch::Tensor& target, const torch::Tensor& render,
                       const TrustOptions& options, double contrast) {
  const Fixed fixed(render);
  torch::Tensor drawn = target;
  const double band = options.tolerance * contrast;
  if (band > 0) drawn = within_band(drawn, fixed, band);
  if (options.scale > 0) drawn = trusted(drawn, fixed, options.scale);
  return drawn;
}

}  // namespace jade::losses
