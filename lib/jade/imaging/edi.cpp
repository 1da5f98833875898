// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/edi.h"

#include <cmath>
#include <torch/types.h>
#include <vector>

#include "jade/core/check.h"
#include "jade/geometry/trajectory.h"

namespace jade::imaging {

using events::EdiIndex;
using geometry::kExposurePoses;
using geometry::kMidPose;

EdiKernel edi_kernel(const torch::Tensor& windows, EdiIndex index) {
  check_shape(windows, "EDI windows", {kExposurePoses - 1, -1, -1});
  const auto before = windows.narrow(0, 0, 4).flip(0).cumsum(0).flip(0).neg();
  const auto after = windows.narrow(0, 4, 4).cumsum(0);
  const auto log_ratio = torch::cat({before, torch::zeros_like(windows.narrow(0, 0, 1)), after});
  const auto log_blur = log_ratio.logsumexp(0) - std::log(double(kExposurePoses));
  auto gain = (log_ratio - log_blur).exp();
  if (index == EdiIndex::kDiet) {
    gain = torch::cat({gain.narrow(0, 0, 5), gain.narrow(0, 6, 3), gain.narrow(0, 8, 1)});
  }
  return {gain, log_blur.exp()};
}

torch::Tensor edi_mid(const torch::Tensor& blurry, const EdiKernel& kernel) {
  check_shape(blurry, "blurry", {-1, kernel.blur.size(0), kernel.blur.size(1)});
  check_same_device(blurry, "blurry", kernel.blur, "EDI kernel");
  return blurry * kernel.gain.narrow(0, kMidPose, 1);
}

}  // namespace jade::imaging
