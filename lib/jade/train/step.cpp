// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step.h"

#include "jade/train/routing_step.h"

namespace jade::train {

StepOutputs alternate(TrainState& state, const StepInputs& inputs, int64_t step,
                      const RunOptions& options) {
  const View& view = inputs.view;
  StepOutputs out;
  out.renders = render_exposure(state, view, inputs.view_index, inputs.poses, step, options);
  RouteReport route;
  torch::Tensor target;
  if (losses::target_acts(options.objective, step)) {
    route = routing_step(state, view, inputs.view_index, out.renders, options.route);
    target = scene_target(state, view, inputs.view_index);
  }
  out.terms =
      scene_step(state, {view, out.renders, target, inputs.poses, inputs.events}, step, options);
  if (route.render.defined()) out.terms.push_back({"route_render", route.render});
  if (route.reblur.defined()) out.terms.push_back({"route_reblur", route.reblur});
  return out;
}

}  // namespace jade::train
