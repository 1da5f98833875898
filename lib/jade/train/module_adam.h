// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::train {

/// Adam over a few small tensors in one fused call, with its step counter on their device: for the
/// router and the camera response, where launches would cost more than the arithmetic.
class ModuleAdam {
 public:
  ModuleAdam() = default;
  ModuleAdam(std::vector<torch::Tensor> parameters, double lr, double eps = 1e-8);

  bool empty() const { return parameters_.empty(); }

  /// Updates the parameters that have a gradient. A parameter without one keeps its value, moments
  /// and step count; at least one must have one.
  void step() { step(lr_); }
  /// Steps with another step size.
  void step(double lr);
  /// Sets all gradients to undefined.
  void zero_grad();

  /// Calls `visitor(name, tensor)` for the moments and step counters of each parameter.
  template <class Visitor>
  void visit(Visitor&& visitor) const {
    for (size_t i = 0; i < parameters_.size(); ++i) {
      visitor("first." + std::to_string(i), first_[i]);
      visitor("second." + std::to_string(i), second_[i]);
      visitor("steps." + std::to_string(i), steps_[i]);
    }
  }

 private:
  std::vector<torch::Tensor> parameters_, first_, second_, steps_;
  double lr_ = 0;
  double eps_ = 1e-8;
};

}  // namespace jade::train
