// SPDX-License-Identifier: Apache-2.0
#include "jade/train/sums_ahead.h"

#include <algorithm>
#include <torch/types.h>
#include <utility>

namespace jade::train {

SumsAhead::SumsAhead(const data::Dataset& dataset, const restore::RestoreOptions& options,
                     const restore::RestorerMetadata* network, std::launch policy)
    : dataset_(dataset), options_(options), network_(network), policy_(policy) {
  if (dataset.train.empty()) return;
  constexpr int64_t kMostBytes = int64_t(512) << 20;
  const auto& camera = dataset.train.front().camera;
  const int64_t bytes =
      restore::sum_bytes_per_pixel(options, network) * int64_t(camera.width) * camera.height;
  at_once_ = static_cast<size_t>(std::clamp<int64_t>(kMostBytes / bytes, 1, 4));
}

restore::ExposureSums SumsAhead::next() {
  const size_t all = dataset_.train.size();
  while (begun_.size() < at_once_ && begun_upto_ < all) begin();
  restore::ExposureSums sums = begun_.front().get();
  begun_.pop_front();
  if (begun_upto_ < all) begin();
  return sums;
}

void SumsAhead::begin() {
  begun_.push_back(std::async(policy_, [this, index = begun_upto_] {
    const torch::NoGradGuard no_grad;
    return restore::sum_events(dataset_.train[index], dataset_.events, options_, network_);
  }));
  ++begun_upto_;
}

}  // namespace jade::train
