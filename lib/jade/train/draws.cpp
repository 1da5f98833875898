// SPDX-License-Identifier: Apache-2.0
#include "jade/train/draws.h"

#include <numeric>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/core/random.h"

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

void PoseDraws::draw_block_of(int64_t step) {
  const int64_t block = (step - 1) / kBlock;
  if (block == block_) return;
  block_ = block;
  auto generator = make_generator(seed_, concat("pose draws of block ", block));
  on_host_ = torch::randint(samples_, {kBlock, 3}, generator, torch::kInt64);
  if (target_) {
    auto of_target = make_generator(seed_, concat("target poses of block ", block));
    const auto fourth = torch::randint(samples_, {kBlock, 1}, of_target, torch::kInt64);
    on_host_ = torch::cat({on_host_, fourth}, 1);
  }
  draws_ = on_host_.to(device_);
}

torch::Tensor PoseDraws::at(int64_t step) {
  draw_block_of(step);
  return draws_[(step - 1) % kBlock];
}

const int64_t* PoseDraws::on_host(int64_t step) {
  draw_block_of(step);
  return on_host_.const_data_ptr<int64_t>() + (step - 1) % kBlock * on_host_.size(1);
}

torch::Tensor TermWeights::at(int64_t step) {
  if (!losses::weights_fall(options_)) return {};
  const int64_t block = (step - 1) / kBlock;
  if (block != block_) {
    block_ = block;
    const torch::Tensor rows = torch::empty({kBlock, 2}, torch::kFloat32);
    auto* const out = rows.mutable_data_ptr<float>();
    for (int64_t i = 0; i < kBlock; ++i) {
      const auto weights = losses::term_weights(options_, block * kBlock + i + 1, steps_);
      for (int64_t term = 0; term < 2; ++term) {
        out[2 * i + term] = static_cast<float>(weights[static_cast<size_t>(term)]);
      }
    }
    weights_ = rows.to(device_);
  }
  return weights_[(step - 1) % kBlock];
}

}  // namespace jade::train
