// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/target.h"

#include "jade/imaging/color.h"
#include "jade/losses/rec.h"

namespace jade::losses {

torch::Tensor target_loss(const torch::Tensor& mid_render, const Fixed& target, double dssim) {
  return rec_loss(mid_render, *target, dssim) +
         rec_loss(imaging::gray(mid_render), imaging::gray(*target), dssim);
}

}  // namespace jade::losses
