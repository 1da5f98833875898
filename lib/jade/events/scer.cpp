// SPDX-License-Identifier: Apache-2.0
#include "jade/events/scer.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::events {

torch::Tensor scer(const torch::Tensor& bins) {
  check_shape(bins, "bins", {6, -1, -1});
  const auto before = bins.narrow(0, 0, 3).flip(0).cumsum(0).flip(0).neg();
  const auto after = bins.narrow(0, 3, 3).cumsum(0);
  const auto sums = torch::cat({before, after});
  const auto largest = sums.abs().max();
  return torch::where(largest > 0, sums / largest, torch::zeros_like(sums));
}

torch::Tensor event_mask(const torch::Tensor& events) {
  check_shape(events, "events", {-1, -1, -1});
  const auto active = events.ne(0).any(0, true).to(events.scalar_type()).unsqueeze(0);
  const auto dilated = torch::max_pool2d(active, 3, 1, 1);
  return torch::max_pool2d(dilated.neg(), 3, 1, 1).neg().squeeze(0);
}

}  // namespace jade::events
