// SPDX-License-Identifier: Apache-2.0
#include "jade/train/routing_step.h"

#include <torch/types.h>

namespace jade::train {

torch::Tensor routing_alpha(TrainState& state, const StepInputs& inputs, const StepPlan& plan) {
  if (!plan.route) return {};
  return state.allocation->forward(inputs.view.measured, inputs.view_index);
}

RouteReport routing_step(TrainState& state, const StepInputs& inputs, const torch::Tensor& alpha,
                         const Renders& renders, const StepPlan& plan,
                         const losses::RouteOptions& options) {
  if (!plan.route) return {};
  const View& view = inputs.view;
  const auto loss = losses::route_loss(alpha, view.restorations, losses::Fixed(renders.of_target()),
                                       view.reblur_kernel, view.blurry(), options);
  state.allocation.adam.zero_grad();
  loss.total.backward();
  state.allocation.adam.step();
  return {loss.render, loss.reblur};
}

torch::Tensor allocation_map(TrainState& state, const View& view, int64_t view_index) {
  if (!state.allocation) return {};
  const torch::NoGradGuard no_grad;
  return state.allocation->forward(view.measured, view_index);
}

torch::Tensor scene_target(TrainState& state, const View& view, int64_t view_index) {
  if (view.fixed_target.defined() || !state.allocation) return view.fixed_target;
  return restore::fuse(allocation_map(state, view, view_index), view.restorations);
}

}  // namespace jade::train
