// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::train {

/// All that RowAdam keeps, on the device of its parameter.
struct RowAdamState {
  torch::Tensor first, second;  ///< moments, as the parameter
  torch::Tensor steps;          ///< [V] float64, updates of each row
  torch::Tensor gradient;       ///< as the parameter, added up since the last update
  torch::Tensor seen;           ///< [V] int64, gradients in it per row
};

/// Adam over the rows of one parameter [V,...], float64, of which a step sees a few: each row has a
/// step count of its own, and one without a gradient stays as it is, with its moments. Adding
/// gradients up asks nothing of the host, so it can be recorded (step_graph.h); the update stands
/// outside.
class RowAdam {
 public:
  RowAdam() = default;
  /// @param parameter  contiguous, on the device where it stays; a GPU is the current device at
  ///   every call
  explicit RowAdam(torch::Tensor parameter, double eps = 1e-8);

  bool empty() const { return !parameter_.defined(); }

  /// Sets the parameter's gradient to undefined.
  void zero_grad() { parameter_.mutable_grad() = torch::Tensor(); }
  /// Adds the parameter's gradient, of row `row` alone, to those that wait. @param row  [1] int64
  void accumulate(const torch::Tensor& row);
  /// One Adam step of every row whose gradient waits; none waits afterwards.
  void update(double lr);

  const RowAdamState& state() const { return state_; }
  /// Takes the values of `saved`; `gradient` and `seen` may be undefined: none waits.
  /// @throws ContractError for other shapes.
  void restore(const RowAdamState& saved);

 private:
  torch::Tensor parameter_;
  RowAdamState state_;
  double eps_ = 1e-8;
};

}  // namespace jade::train
