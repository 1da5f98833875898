// SPDX-License-Identifier: Apache-2.0
#include "jade/run/allocation_choice.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/eval/metrics.h"

namespace jade::run {

AllocationChoice allocation_choice(const torch::Tensor& alpha,
                                   const restore::Restorations& restorations,
                                   const torch::Tensor& truth) {
  const auto sharp = truth.to(alpha.device());
  const auto distance = [&](const torch::Tensor& image) { return (image - sharp).abs().mean(0); };
  const auto edi = distance(restorations.edi), efnet = distance(restorations.efnet);
  const auto decided = edi != efnet;
  AllocationChoice choice;
  if (decided.any().item<bool>()) {
    const auto prefers_edi = (alpha > 0.5).expand({1, edi.size(0), edi.size(1)})[0];
    const auto right = prefers_edi == (edi < efnet);
    choice.right = right.masked_select(decided).to(torch::kFloat64).mean().item<double>();
  }
  choice.gain_db =
      eval::psnr(restore::fuse(alpha, restorations), sharp) -
      std::max(eval::psnr(restorations.edi, sharp), eval::psnr(restorations.efnet, sharp));
  return choice;
}

}  // namespace jade::run
