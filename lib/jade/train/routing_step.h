// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/losses/route.h"
#include "jade/train/plan.h"
#include "jade/train/state.h"
#include "jade/train/step_inputs.h"

namespace jade::train {

/// Terms of the routing step, as detached device scalars; terms that are off are undefined.
struct RouteReport {
  torch::Tensor render, reblur;
};

/// α [1,H,W] of the inputs' view with its graph, with which the routing step begins; it needs no
/// renders. Undefined if the plan does not update θ.
torch::Tensor routing_alpha(TrainState& state, const StepInputs& inputs, const StepPlan& plan);

/// One Adam step on θ, Eq. (2) to (7): computes α from the measurements, the fused target I_pseudo,
/// its distance to a stop-gradient copy of the render at the target's pose, and its distance to the
/// blurry frame after reblurring.
/// Changes neither φ nor its optimiser. Does nothing if the plan does not update θ.
/// @param alpha routing_alpha() of the same state, inputs and plan
RouteReport routing_step(TrainState& state, const StepInputs& inputs, const torch::Tensor& alpha,
                         const Renders& renders, const StepPlan& plan,
                         const losses::RouteOptions& options);

/// α [1,H,W] of a view for the current θ, without gradient; undefined without an allocation.
torch::Tensor allocation_map(TrainState& state, const View& view, int64_t view_index);

/// sg(I_pseudo) for the current θ, Eq. (4), or the view's fixed target; undefined if there is none.
torch::Tensor scene_target(TrainState& state, const View& view, int64_t view_index);

}  // namespace jade::train
