// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/losses/objective.h"

namespace jade::run {

/// Detects NaN and Inf in the loss terms without waiting for the device: counts finite values
/// there, and derives the step of the first bad one from the count in check(). Steps with other
/// terms may alternate: each set of terms has its own counts.
class TermMonitor {
 public:
  /// Call after each step.
  void watch(const std::vector<losses::NamedTerm>& terms, int64_t step);

  /// @throws NumericError naming the step and the term. Waits for the device.
  void check();

 private:
  /// Steps with the same terms since the last check.
  struct Count {
    std::vector<std::string> names;
    torch::Tensor finite_steps;  // [terms] int64 on the device
    std::vector<int64_t> steps;
  };

  Count& count_of(const std::vector<losses::NamedTerm>& terms);

  std::vector<Count> counts_;
};

}  // namespace jade::run
