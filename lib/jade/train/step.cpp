// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step.h"

#include "jade/train/routing_step.h"

namespace jade::train {

StepOutputs alternate(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                      const RunOptions& options) {
  StepOutputs out;
  out.renders = render_exposure(state, inputs, plan, options);
  const RouteReport route = routing_step(state, inputs, out.renders, plan, options.route);
  torch::Tensor target;
  if (plan.objective.target) target = scene_target(state, inputs.view, inputs.view_index);
  out.terms = scene_step(state, inputs, out.renders, target, plan, options);
  if (route.render.defined()) out.terms.push_back({"route_render", route.render, false});
  if (route.reblur.defined()) out.terms.push_back({"route_reblur", route.reblur, false});
  return out;
}

void update_poses(TrainState& state, const RunOptions& options, int64_t step) {
  if (!state.poses || step % options.poses.accumulate != 0) return;
  state.poses_adam.update(pose_lr(options.poses, step));
  state.poses->hold_gauge();
}

}  // namespace jade::train
