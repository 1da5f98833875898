// SPDX-License-Identifier: Apache-2.0
// The random choices of a step as functions of only the seed and the step: a resumed run repeats
// them without saved state, and more iterations do not change them.
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/losses/objective.h"

namespace jade::train {

/// The view of each step: every epoch is a new shuffle of all views, one view per step.
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

/// The sampled poses of L_edi gray, L_edi colour and L_sim for each step, and of L_tgt if
/// requested, each uniform in 0..K−1, the last among every `target_every`-th of them. A block of
/// steps is sampled and copied to the device at once. Requesting the fourth does not change the
/// other three.
class PoseDraws {
 public:
  PoseDraws() = default;
  PoseDraws(uint64_t seed, torch::Device device, int64_t samples = 9, bool target = false,
            int64_t target_every = 1)
      : seed_(seed),
        device_(device),
        samples_(samples),
        target_(target),
        target_every_(target_every) {}
  /// [3] int64 on the device, [4] with that of L_tgt. @param step  counted from 1.
  torch::Tensor at(int64_t step);
  /// Host copy of the samples, without waiting for the device; valid until the next call.
  const int64_t* on_host(int64_t step);

 private:
  void draw_block_of(int64_t step);

  uint64_t seed_ = 0;
  torch::Device device_ = torch::kCPU;
  int64_t samples_ = 9;
  bool target_ = false;
  int64_t target_every_ = 1;
  int64_t block_ = -1;
  torch::Tensor draws_, on_host_;  // [kBlock,3] or [kBlock,4]
};

/// The weights of L_tgt and L_edi for each step, if they decrease during the run.
class TermWeights {
 public:
  TermWeights() = default;
  TermWeights(const losses::ObjectiveOptions& options, int64_t steps, torch::Device device)
      : options_(options), steps_(steps), device_(device) {}
  /// [2] float32 on the device; undefined if they are constant. @param step  counted from 1.
  torch::Tensor at(int64_t step);

 private:
  losses::ObjectiveOptions options_;
  int64_t steps_ = 0;
  torch::Device device_ = torch::kCPU;
  int64_t block_ = -1;
  torch::Tensor weights_;  // [kBlock,2]
};

}  // namespace jade::train
