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

}  // namespace jade::imaging
