// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/route.h"

#include "jade/core/check.h"

namespace jade::losses {

RouteLoss route_loss(const torch::Tensor& pseudo, const Fixed& mid_render,
                     const torch::Tensor& reblur_kernel, const torch::Tensor& blurry,
                     const RouteOptions& options) {
  check_shape(pseudo, "I_pseudo", {3, -1, -1});
  RouteLoss loss;
  if (options.render_consistency) {
    check_shape(*mid_render, "middle render", pseudo.sizes().vec());
    loss.render = torch::l1_loss(pseudo, *mid_render);
    loss.total = loss.render;
  }
  if (options.reblur_consistency) {
    check_shape(reblur_kernel, "reblur kernel", {1, pseudo.size(1), pseudo.size(2)});
    check_shape(blurry, "blurry frame", pseudo.sizes().vec());
    loss.reblur = torch::l1_loss(pseudo * reblur_kernel, blurry);
    if (options.reblur_weight != 1) loss.reblur = loss.reblur * options.reblur_weight;
    loss.total = loss.total.defined() ? loss.total + loss.reblur : loss.reblur;
  }
  return loss;
}

}  // namespace jade::losses
