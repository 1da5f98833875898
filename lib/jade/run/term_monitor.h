// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/losses/objective.h"

namespace jade::run {

/// Watches the loss terms for NaN and Inf without waiting for the device: it counts finite values
/// there, and from the count tells the step of the first bad one when asked.
class TermMonitor {
 public:
  /// After each step.
  void watch(const std::vector<losses::NamedTerm>& terms, int64_t step);

  /// @throws NumericError naming the step and the term. Waits for the device.
  void check();

 private:
  void start(const std::vector<losses::NamedTerm>& terms, int64_t step);

  std::vector<std::string> names_;
  torch::Tensor finite_steps_;  // [terms] int64 on the device
  int64_t first_step_ = 0;      // of this count
  int64_t steps_ = 0;           // counted
};

}  // namespace jade::run
