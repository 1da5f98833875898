// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::train {

/// State of RowAdam, on the device of its parameter.
struct RowAdamState {
  torch::Tensor first, second;  ///< moments, as the parameter
  torch::Tensor steps;          ///< [V] float64, updates of each row
  torch::Tensor gradient;       ///< shape of the parameter, accumulated since the last update
  torch::Tensor seen;           ///< [V] int64, number of accumulated gradients per row
};

/// Adam over the rows of one parameter [V,...], float64, of which a step uses a few: each row has
/// its own step count, and a row without a gradient keeps its value and moments. Accumulating
/// gradients does not synchronise, so it can be captured (step_graph.h); the update runs outside
/// the graph.
class RowAdam {
 public:
  RowAdam() = default;
  /// @param parameter  contiguous, stays on its device; a GPU must be the current device at every
  ///   call
  explicit RowAdam(torch::Tensor parameter, double eps = 1e-8);

  bool empty() const { return !parameter_.defined(); }

  /// Adds the parameter's gradient, which only row `row` has, to the accumulated one.
  /// @param row [1] int64
  void accumulate(const torch::Tensor& row);
  /// One Adam step of every row with an accumulated gradient, which is then reset.
  void update(double lr);

  const RowAdamState& state() const { return state_; }
  /// Calls `visitor(name, tensor)` for each tensor of the state; for none if empty.
  template <class Visitor>
  void visit(Visitor&& visitor) const {
    if (empty()) return;
    visitor("first", state_.first);
    visitor("second", state_.second);
    visitor("steps", state_.steps);
    visitor("gradient", state_.gradient);
    visitor("seen", state_.seen);
  }

 private:
  torch::Tensor parameter_;
  RowAdamState state_;
  double eps_ = 1e-8;
};

}  // namespace jade::train
