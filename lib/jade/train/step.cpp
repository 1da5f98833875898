// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step.h"

#include "jade/kernel/side_stream.h"
#include "jade/train/routing_step.h"

namespace jade::train {

StepOutputs alternate(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                      const RunOptions& options) {
  StepOutputs out;
  // On a GPU the router runs beside the renders, and L_tgt beside the other terms and their
  // gradients.
  const torch::Device device = inputs.view.blurry.device();
  kernel::SideStream side(device.is_cuda() ? device.index() : -1);
  torch::Tensor alpha, target;
  RouteReport route;
  const auto make_target = [&] {
    route = routing_step(state, inputs, alpha, out.renders, plan, options.route);
    if (plan.objective.target) target = scene_target(state, inputs.view, inputs.view_index);
  };
  const bool routed = state.allocation && (plan.route || plan.objective.target);
  if (routed) side.follow();
  out.renders = render_exposure(state, inputs, plan, options);
  losses::Beside beside;
  if (routed) {
    side.run([&] { alpha = routing_alpha(state, inputs, plan); });
    side.follow();
    side.run(make_target);
    if (side.apart()) {
      beside = [&](const std::function<void()>& work) {
        side.follow();
        side.run(work);
      };
    }
  } else {
    make_target();
  }
  out.terms = scene_step(state, inputs, out.renders, target, plan, options, beside);
  side.join();
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
