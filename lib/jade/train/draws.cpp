// SPDX-License-Identifier: Apache-2.0
#include "jade/train/draws.h"

#include <numeric>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/geometry/trajectory.h"

namespace jade::train {
namespace {

constexpr int64_t kBlock = 1024;

}  // namespace

int64_t ViewOrder::at(int64_t step) {
  const int64_t epoch = (step - 1) / views_;
  if (epoch != epoch_) {
    epoch_ = epoch;
    auto generator = make_generator(seed_, concat("view order of epoch ", epoch));
    order_.resize(static_cast<size_t>(views_));
    std::iota(order_.begin(), order_.end(), int64_t{0});
    for (int64_t i = views_ - 1; i > 0; --i)
      std::swap(order_[i], order_[draw_index(generator, i + 1)]);
  }
  return order_[static_cast<size_t>((step - 1) % views_)];
}

torch::Tensor PoseDraws::at(int64_t step) {
  const int64_t block = (step - 1) / kBlock;
  if (block != block_) {
    block_ = block;
    auto generator = make_generator(seed_, concat("pose draws of block ", block));
    draws_ =
        torch::randint(geometry::kExposurePoses, {kBlock, 3}, generator, torch::kInt64).to(device_);
  }
  return draws_[(step - 1) % kBlock];
}

}  // namespace jade::train
