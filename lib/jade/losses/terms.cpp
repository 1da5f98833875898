// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/terms.h"

#include "jade/imaging/color.h"

namespace jade::losses {
namespace {

/// g of an image; a gray image is returned unchanged.
torch::Tensor in_gray(const torch::Tensor& image) {
  return image.size(0) == 1 ? image : imaging::gray(image);
}

}  // namespace

torch::Tensor target_loss(const torch::Tensor& mid_render, const Fixed& target, double dssim) {
  return imaging::l1_ssim_sum({{target_pairs(mid_render, target), 1, {}}}, dssim).total;
}

std::vector<imaging::L1SsimPair> target_pairs(const torch::Tensor& mid_render,
                                              const Fixed& target) {
  return {{mid_render, {*target, {}, {}}},
          {imaging::gray(mid_render), {imaging::gray(*target), {}, {}}}};
}

torch::Tensor where_agreed(const torch::Tensor& value, double bound) {
  return value * value.detach().lt(bound);
}

imaging::L1SsimPair blur_pair(const torch::Tensor& mean_render, const imaging::SsimTarget& blurry) {
  return {mean_render, blurry};
}

imaging::L1SsimPair edi_gray_pair(const torch::Tensor& toned_render,
                                  const torch::Tensor& toned_blurry,
                                  const torch::Tensor& edi_factor) {
  return {in_gray(toned_render), {in_gray(toned_blurry) * edi_factor, {}, {}}};
}

imaging::L1SsimPair edi_color_pair(const torch::Tensor& render, const torch::Tensor& blurry,
                                   const torch::Tensor& edi_factor) {
  return {render, {blurry * edi_factor, {}, {}}};
}

imaging::L1SsimPair simulation_pair(const torch::Tensor& toned_render,
                                    const torch::Tensor& toned_mean,
                                    const torch::Tensor& edi_factor) {
  return {in_gray(toned_render), {in_gray(toned_mean) * edi_factor, {}, {}}};
}

imaging::L1SsimPair intensity_pair(const torch::Tensor& mean_toned,
                                   const torch::Tensor& toned_blurry) {
  return {mean_toned, {toned_blurry, {}, {}}};
}

}  // namespace jade::losses
