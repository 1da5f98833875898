// SPDX-License-Identifier: Apache-2.0
#include "jade/train/sums_ahead.h"

#include <algorithm>
#include <torch/types.h>

namespace jade::train {

data::Exposure masked(const data::Exposure& exposure) {
  data::Exposure out = exposure;
  if (out.mask.defined()) out.blurry = out.blurry.masked_fill(out.mask.logical_not(), 0);
  return out;
}

SumsAhead::SumsAhead(const data::Dataset& dataset, const restore::RestoreOptions& options,
                     const restore::ViewRestorer& restorer, std::launch policy,
                     int64_t most_device_bytes)
    : dataset_(dataset),
      options_(options),
      restorer_(restorer),
      network_(restorer.has_network() ? &restorer.metadata() : nullptr),
      policy_(policy),
      most_device_bytes_(most_device_bytes) {
  if (dataset.train.empty()) return;
  constexpr int64_t kMostBytes = int64_t{2} << 30;
  const auto& camera = dataset.train.front().camera;
  const int64_t bytes =
      restore::sum_bytes_per_pixel(options, network_) * int64_t(camera.width) * camera.height;
  const auto at_once = static_cast<size_t>(std::clamp<int64_t>(kMostBytes / bytes, 1, 4));
  at_once_ = std::min(at_once, dataset.train.size());
  while (begun_.size() < at_once_) begin();
}

restore::ExposureSums SumsAhead::next() {
  restore::ExposureSums sums = begun_.front().get();
  begun_.pop_front();
  if (begun_upto_ < dataset_.train.size()) begin();
  return sums;
}

void SumsAhead::begin() {
  begun_.push_back(std::async(policy_, [this, index = begun_upto_] {
    const torch::NoGradGuard no_grad;
    const data::Exposure exposure = masked(dataset_.train[index]);
    restore::ExposureSums sums = restore::sum_events(exposure, dataset_.events, options_, network_);
    restore::look_up(exposure, options_, restorer_, sums);
    const auto bytes = static_cast<int64_t>(sums.windows.nbytes());
    constexpr int64_t kLeastBytes = 64 << 20;  // fewer are copied in a hundredth of a second
    if (bytes >= kLeastBytes && bytes * int64_t(at_once_ + 1) <= most_device_bytes_) {
      restore::upload(restorer_.device(), sums);
    }
    return sums;
  }));
  ++begun_upto_;
}

}  // namespace jade::train
