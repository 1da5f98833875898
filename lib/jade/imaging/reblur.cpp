// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/reblur.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::imaging {

torch::Tensor reblur_kernel(const events::EventVoxel& voxel, double contrast, double moment) {
  check_shape(voxel.values, "voxel", {-1, -1, -1});
  const int64_t bins = voxel.bins();
  JADE_CHECK(bins > 0 && bins % 2 == 0, "expected an even number of bins, so that one ends at ",
             "mid-exposure, found ", bins);
  JADE_CHECK(moment >= 0 && moment <= 1, "expected a moment from 0 to 1, found ", moment);
  const auto sums = voxel.values.cumsum(0);
  const auto at_edges = torch::cat({torch::zeros_like(sums.narrow(0, 0, 1)), sums});
  const double place = moment * static_cast<double>(bins);
  const auto bin = std::min(static_cast<int64_t>(place), bins - 1);
  const auto reference = torch::lerp(at_edges.narrow(0, bin, 1), at_edges.narrow(0, bin + 1, 1),
                                     place - static_cast<double>(bin));
  return ((sums - reference) * contrast).exp().mean(0, true);
}

}  // namespace jade::imaging
