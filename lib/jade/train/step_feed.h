// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/train/bank.h"
#include "jade/train/draws.h"
#include "jade/train/event_windows.h"
#include "jade/train/options.h"
#include "jade/train/step_inputs.h"

namespace jade::train {

/// Inputs of a run's steps, as functions of seed and step: the view, the poses of its terms and, if
/// the options need them, weights, event windows and restorations of a sampled pose.
class StepFeed {
 public:
  StepFeed() = default;
  /// Restores all exposures: see ViewBank, also for errors.
  /// @param options  settled
  StepFeed(const data::Dataset& dataset, const RunOptions& options, torch::Device device,
           std::unique_ptr<Restoring> begun = nullptr,
           int64_t most_device_bytes = kMostConstantBytes);

  /// @param step  counted from 1
  StepInputs at(int64_t step);

  const ViewBank& bank() const { return bank_; }

 private:
  /// Selects samples and weights for steps with every `stride`-th moment.
  void set_stride(int64_t stride);
  /// Reduces the view to the moments of the stride.
  void thin(View& view) const;

  RunOptions options_;
  ViewBank bank_;
  ViewOrder order_{0, 1};
  torch::Device device_ = torch::kCPU;
  int64_t stride_ = 0;     // stride of pose_draws_ and weights_
  PoseDraws pose_draws_;   // among the moments of the stride
  torch::Tensor weights_;  // for these moments; undefined for a stride of 1
  TermWeights term_weights_;
  torch::Tensor view_picks_;                     // 0, 1, … on the device
  std::unique_ptr<EventWindows> event_windows_;  // for L_ev
};

}  // namespace jade::train
