// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>

#include "jade/core/fields.h"
#include "jade/losses/fixed.h"
#include "jade/restore/restorations.h"

namespace jade::losses {

struct RouteOptions {
  double lr = 5e-4;
  bool render_consistency = true;
  bool reblur_consistency = true;
  double reblur_weight = 1;
  double reblur_contrast = 1;
};

template <class V>
void describe(V& v, RouteOptions& o) {
  v.field("lr", o.lr, "Adam step size of the allocation (joint_lr)", Range{1e-8, 1});
  v.field("render_consistency", o.render_consistency, "first term of Eq. (6)");
  v.field("reblur_consistency", o.reblur_consistency, "second term of Eq. (6)");
  v.field("reblur_weight", o.reblur_weight, "factor of that term; 1 is Eq. (6)", Range{0, 1e3});
  v.field("reblur_contrast", o.reblur_contrast,
          "c of Eq. (7) on the voxel divided by its largest value; 1 in the paper; 0: the "
          "calibrated one, mean contrast threshold times that value",
          Range{0, 1e3});
  v.fixed("every", 1);
}

/// Scalars; a term that is off is undefined.
struct RouteLoss {
  torch::Tensor total;           ///< undefined if both are off
  torch::Tensor render, reblur;  ///< its parts with weights applied, detached, for logging
};

/// L_route = ‖I_pseudo − sg(Î_mid)‖₁ + w ‖I_pseudo ⊙ K(V) − B‖₁, Eq. (6) with w = 1, for I_pseudo =
/// α ⊙ I_edi + (1 − α) ⊙ F, Eq. (4), with the kernel K of the reblur operator of Eq. (7). Both
/// terms are means over pixels and channels. One pass each for forward and backward (route_math.h).
/// float or double on the CPU, float32 on a GPU.
/// @param alpha          [1,H,W]. Differentiable, once: Eq. (5).
/// @param restorations   constant
/// @param mid_render     [3,H,W], Î_mid
/// @param reblur_kernel  [1,H,W], K(V) (imaging/reblur.h). Constant.
/// @param blurry         [3,H,W], B. Constant.
/// @throws ContractError for shapes, types and devices that do not match.
RouteLoss route_loss(const torch::Tensor& alpha, const restore::Restorations& restorations,
                     const Fixed& mid_render, const torch::Tensor& reblur_kernel,
                     const torch::Tensor& blurry, const RouteOptions& options);

}  // namespace jade::losses
