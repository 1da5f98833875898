// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step.h"

#include "jade/kernel/side_stream.h"
#include "jade/train/routing_step.h"

namespace jade::train {

StepOutputs alternate(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                      const RunOptions& options) {
  StepOutputs out;
  // Runs concurrently on a GPU: the renders, the router and the response table; L_tgt and the other
  // terms with their gradients, including that of the table's network; the small updates and that
  // of the Gaussians.
  const torch::Device device = inputs.view.measured.device();
  kernel::SideStream side(device.is_cuda() ? device.index() : -1);
  torch::Tensor alpha, target, table;
  RouteReport route;
  side.follow();
  out.renders = render_exposure(state, inputs, plan, options);
  side.run([&] {
    if (state.response && plan.objective.response) table = state.response->table();
    alpha = routing_alpha(state, inputs, plan);
  });
  side.join();
  side.follow();
  side.run([&] {
    route = routing_step(state, inputs, alpha, out.renders, plan, options.route);
    if (plan.objective.target) target = scene_target(state, inputs.view, inputs.view_index);
  });
  Beside beside;
  if (side.apart()) {
    beside = [&](const std::function<void()>& work) {
      side.follow();
      side.run(work);
    };
  }
  out.terms = scene_step(state, inputs, out.renders, target, plan, options, beside, table);
  side.join();
  if (route.render.defined()) out.terms.push_back({"route_render", route.render, false});
  if (route.reblur.defined()) out.terms.push_back({"route_reblur", route.reblur, false});
  return out;
}

void update_exposures(TrainState& state, const RunOptions& options, int64_t step) {
  if (state.poses) {
    state.poses.adam.update(pose_lr(options.poses, step));
    state.poses->hold_gauge();
  }
  if (state.gains.adam.empty()) return;
  state.gains.adam.update(options.gains.lr);
  state.gains->hold_mean();
}

}  // namespace jade::train
