// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/reblur.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::imaging {

torch::Tensor reblur_kernel(const events::EventVoxel& voxel, double contrast) {
  check_shape(voxel.values, "voxel", {-1, -1, -1});
  const int64_t bins = voxel.bins();
  JADE_CHECK(bins > 0 && bins % 2 == 0, "expected an even number of bins, so that one ends at ",
             "mid-exposure, found ", bins);
  const auto sums = voxel.values.cumsum(0);
  return ((sums - sums.narrow(0, bins / 2 - 1, 1)) * contrast).exp().mean(0, true);
}

torch::Tensor reblur(const torch::Tensor& image, const events::EventVoxel& voxel, double contrast) {
  check_shape(image, "image", {-1, voxel.values.size(1), voxel.values.size(2)});
  check_same_device(image, "image", voxel.values, "voxel");
  return image * reblur_kernel(voxel, contrast);
}

torch::Tensor unblur(const torch::Tensor& blurry, const events::EventVoxel& voxel,
                     double contrast) {
  check_shape(blurry, "blurry", {-1, voxel.values.size(1), voxel.values.size(2)});
  check_same_device(blurry, "blurry", voxel.values, "voxel");
  return blurry / reblur_kernel(voxel, contrast);
}

}  // namespace jade::imaging
