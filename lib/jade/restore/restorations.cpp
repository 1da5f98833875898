// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restorations.h"

#include "jade/core/check.h"

namespace jade::restore {

torch::Tensor fuse(const torch::Tensor& alpha, const Restorations& restorations) {
  check_shape(restorations.edi, "I_edi", {3, -1, -1});
  check_shape(restorations.efnet, "F(B, V)", restorations.edi.sizes().vec());
  // The formula of fusion_math.h in one launch.
  return torch::lerp(restorations.efnet, restorations.edi, alpha);
}

torch::Tensor without_tint(const torch::Tensor& image) {
  if (image.dim() == 4) {
    check_shape(image, "images", {-1, 3, -1, -1});
  } else {
    check_shape(image, "image", {3, -1, -1});
  }
  return image.mean(-3, true).expand_as(image).contiguous();
}

}  // namespace jade::restore
