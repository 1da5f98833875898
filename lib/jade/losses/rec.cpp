// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/rec.h"

#include "jade/core/check.h"

namespace jade::losses {

torch::Tensor rec_loss(const torch::Tensor& a, const torch::Tensor& c, double dssim) {
  check_shape(c, "rec_loss: second image", a.sizes().vec());
  return imaging::l1_ssim(a, c, dssim);
}

torch::Tensor rec_loss(const imaging::L1SsimPair& images, double dssim) {
  return imaging::l1_ssim(images.a, images.c, dssim);
}

}  // namespace jade::losses
