// SPDX-License-Identifier: Apache-2.0
// The random choices of a step as functions of the seed and the step alone: a resumed run makes the
// same ones without any saved state, and raising the number of iterations changes none.
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

namespace jade::train {

/// Which view each step takes: every epoch is a new shuffle of all views, one view a step.
class ViewOrder {
 public:
  ViewOrder(uint64_t seed, int64_t views) : seed_(seed), views_(views) {}
  /// @param step  counted from 1.
  int64_t at(int64_t step);

 private:
  uint64_t seed_;
  int64_t views_;
  int64_t epoch_ = -1;
  std::vector<int64_t> order_;
};

/// The poses of L_edi gray, L_edi colour and L_sim for each step, each uniform in 0..8. A block of
/// steps is drawn and brought to the device at once.
class PoseDraws {
 public:
  PoseDraws(uint64_t seed, torch::Device device) : seed_(seed), device_(device) {}
  /// [3] int64 on the device. @param step  counted from 1.
  torch::Tensor at(int64_t step);

 private:
  uint64_t seed_;
  torch::Device device_;
  int64_t block_ = -1;
  torch::Tensor draws_;  // [kBlock,3]
};

}  // namespace jade::train
