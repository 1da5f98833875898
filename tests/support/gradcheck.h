// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::test {

struct GradcheckOptions {
  double step = 1e-6;
  double absolute = 1e-6;  ///< tolerance: |analytic − numeric| ≤ absolute + relative · |numeric|
  double relative = 1e-5;
  int64_t max_elements = 200;  ///< per input; more are sampled evenly
  uint64_t seed = 0;           ///< of the random cotangent
};

struct GradcheckReport {
  bool passed = true;
  double worst_excess = 0;  ///< largest |analytic − numeric| / tolerance
  int64_t checked = 0;
  std::string message;  ///< worst input, element, analytic and numeric value
};

/// Compares the gradients that autograd gives for ⟨fn(inputs), cotangent⟩, with a fixed random
/// cotangent, against central differences. Inputs must be float64; those that require gradients
/// are checked. An undefined gradient counts as zero.
GradcheckReport gradcheck(const std::function<torch::Tensor(const std::vector<torch::Tensor>&)>& fn,
                          const std::vector<torch::Tensor>& inputs,
                          const std::vector<std::string>& names,
                          const GradcheckOptions& options = {});

}  // namespace jade::test
