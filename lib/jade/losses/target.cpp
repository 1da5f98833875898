// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/target.h"

#include "jade/imaging/color.h"

namespace jade::losses {

torch::Tensor target_loss(const torch::Tensor& mid_render, const Fixed& target, double dssim) {
  return imaging::l1_ssim_sum({{target_pairs(mid_render, target), 1, {}}}, dssim).total;
}

std::vector<imaging::L1SsimPair> target_pairs(const torch::Tensor& mid_render,
                                              const Fixed& target) {
  return {{mid_render, {*target, {}, {}}},
          {imaging::gray(mid_render), {imaging::gray(*target), {}, {}}}};
}

}  // namespace jade::losses
