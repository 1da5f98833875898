// SPDX-License-Identifier: Apache-2.0
#include "jade/train/scene_step.h"

#include <torch/csrc/autograd/autograd.h>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::train {
namespace {

losses::ToneCurve tone_curve(TrainState& state, const StepPlan& plan,
                             const torch::Tensor& response_table) {
  if (!state.response || !plan.objective.response) return {};
  return [&state, table = response_table](const std::vector<losses::ToneInput>& asked) mutable {
    if (!table.defined()) table = state.response->table();
    std::vector<response::ResponseInput> inputs;
    for (const losses::ToneInput& each : asked) inputs.push_back({each.image, each.weights});
    return response::CameraResponseImpl::apply_all(inputs, table);
  };
}

/// `data` at the times u, or the learned path's cameras at these times.
splat::CameraBatch learned_cameras(const TrainState& state, const torch::Tensor& view_pick,
                                   const torch::Tensor& u, const splat::CameraBatch& data) {
  splat::CameraBatch cameras = data;
  if (state.poses) {
    cameras.camera_from_world = state.poses->forward(view_pick, u, data.camera_from_world);
  }
  return cameras;
}

splat::RenderOptions render_options(const StepPlan& plan, const RunOptions& options) {
  splat::RenderOptions render = train::render_options(options);
  render.sh_degree = plan.sh_degree;
  return render;
}

/// Cameras of the data and their times in the exposure; `u` is needed for learned poses only.
struct TimedCameras {
  splat::CameraBatch cameras;
  torch::Tensor u;
};

/// Cameras of the inputs' view, or the subset `read`.
TimedCameras exposure_times(const TrainState& state, const StepInputs& inputs,
                            const torch::Tensor& read) {
  TimedCameras timed{inputs.view.cameras, inputs.view.u};
  if (!read.defined()) return timed;
  timed.cameras.camera_from_world = timed.cameras.camera_from_world.index_select(0, read);
  timed.cameras.intrinsics = timed.cameras.intrinsics.index_select(0, read);
  if (state.poses) timed.u = timed.u.index_select(0, read);
  return timed;
}

/// Appends the ends of the window of L_ev as two more cameras, so that one call of the op renders
/// all.
void append_window(const TrainState& state, const EventWindow& window, TimedCameras& timed) {
  JADE_CHECK(window.defined(), "L_ev acts: expected a window of events, found none");
  splat::CameraBatch& all = timed.cameras;
  all.camera_from_world = torch::cat({all.camera_from_world, window.cameras.camera_from_world});
  all.intrinsics = torch::cat({all.intrinsics, window.cameras.intrinsics});
  if (state.poses) timed.u = torch::cat({timed.u, window.u});
}

/// The renders at both ends of the window, with the sensor's response applied.
losses::EventPair event_pair(const EventWindow& window, const torch::Tensor& images,
                             const torch::Tensor& mask, const losses::ToneCurve& tone,
                             const StepPlan& plan, const RunOptions& options) {
  const events::Thresholds thresholds = options.events.thresholds();
  losses::EventPair pair;
  pair.renders = tone ? tone({{images, {}}})[0] : images;
  pair.counts = mask.defined() ? window.counts * mask[0] : window.counts;
  pair.pixels = window.pixels;
  pair.color_filter = window.color_filter;
  pair.threshold_positive = thresholds.positive;
  pair.threshold_negative = thresholds.negative;
  pair.weighted_colors = plan.objective.response;
  return pair;
}

/// Prior that pulls learned gains towards the data set's; undefined without learned gains.
torch::Tensor gain_prior(const TrainState& state, const StepInputs& inputs) {
  if (state.gains.adam.empty()) return {};
  return state.gains->squared_change(inputs.view_pick) * kGainPriorWeight;
}

/// Adds a term unless its value is undefined.
void add_term(losses::Objective& loss, const std::string& name, const torch::Tensor& value) {
  if (!value.defined()) return;
  loss.total = loss.total.defined() ? loss.total + value : value;
  loss.terms.push_back({name, value});
}

}  // namespace

splat::CameraBatch exposure_cameras(const TrainState& state, const StepInputs& inputs,
                                    const torch::Tensor& read) {
  const TimedCameras timed = exposure_times(state, inputs, read);
  return learned_cameras(state, inputs.view_pick, timed.u, timed.cameras);
}

torch::Tensor as_in_frame(const TrainState& state, const StepInputs& inputs,
                          const torch::Tensor& color) {
  const torch::Tensor& mask = inputs.view.mask;
  torch::Tensor seen = color;
  if (state.gains) seen = seen * state.gains->forward(inputs.view_pick);
  if (state.pattern) seen = seen + state.pattern->offsets();
  return mask.defined() ? seen * mask : seen;
}

Renders render_exposure(TrainState& state, const StepInputs& inputs, const StepPlan& plan,
                        const RunOptions& options) {
  splat::RenderOptions render = render_options(plan, options);
  if (plan.statistics) render.statistics = state.densifier.accumulated();
  const int64_t samples = inputs.view.cameras.camera_from_world.size(0);
  const torch::Tensor read = losses::poses_read(plan.objective, inputs.pose_draws, samples);
  TimedCameras timed = exposure_times(state, inputs, read);
  const int64_t poses = timed.cameras.camera_from_world.size(0);
  if (plan.objective.event) append_window(state, inputs.events, timed);
  render.statistics_views = state.densifier.counted_poses(poses);
  const splat::CameraBatch cameras =
      learned_cameras(state, inputs.view_pick, timed.u, timed.cameras);
  Renders renders;
  renders.color = splat::render(state.gaussians.parameters(), cameras, render).color;
  if (plan.objective.event) {
    const std::vector<torch::Tensor> parts = renders.color.split_with_sizes({poses, 2});
    renders.color = parts[0];
    // A gain causes no events: it cancels between the logs of both ends.
    const torch::Tensor& mask = inputs.view.mask;
    renders.window_ends = mask.defined() ? parts[1] * mask : parts[1];
  }
  renders.color = as_in_frame(state, inputs, renders.color);
  renders.all_poses = !read.defined();
  if (plan.objective.drawn_target) {
    renders.target_pose = losses::target_pose(plan.objective, inputs.pose_draws, samples);
  }
  return renders;
}

std::vector<losses::NamedTerm> scene_step(TrainState& state, const StepInputs& step_inputs,
                                          const Renders& renders, const torch::Tensor& target,
                                          const StepPlan& plan, const RunOptions& options,
                                          const Beside& beside,
                                          const torch::Tensor& response_table) {
  const View& view = step_inputs.view;
  losses::ObjectiveInputs inputs;
  inputs.renders = renders.color;
  inputs.blurry = {view.blurry(), view.window_mean, view.window_square};
  inputs.samples = view.cameras.camera_from_world.size(0);
  inputs.weights = view.weights;
  inputs.pose_draws = step_inputs.pose_draws;
  inputs.edi_factors = step_inputs.edi_factors;
  inputs.mask = view.mask;
  inputs.term_weights = step_inputs.term_weights;
  if (target.defined()) inputs.target.emplace(target);
  inputs.tone = tone_curve(state, plan, response_table);
  if (plan.objective.event) {
    inputs.events =
        event_pair(step_inputs.events, renders.window_ends, view.mask, inputs.tone, plan, options);
  }

  const auto apart = [&](const std::function<void()>& work) { beside ? beside(work) : work(); };
  // a separate root of the graph: nothing waits for it or its gradient
  torch::Tensor regularization;
  apart([&] { regularization = state.densifier.regularization(state.gaussians); });
  const losses::ObjectivePlan& terms = plan.objective;
  const losses::Views views = losses::pick_views(inputs, terms);
  const auto part = [&](const losses::ObjectivePlan& of) {
    return losses::objective(views, inputs, of, options.objective);
  };
  losses::Objective loss, target_part;
  if (beside && terms.target) {
    beside([&] { target_part = part(terms.only_target()); });
    loss = part(terms.without_target());
    loss.terms.insert(loss.terms.begin(), target_part.terms.begin(), target_part.terms.end());
  } else {
    loss = part(terms);
  }
  if (regularization.defined()) loss.terms.push_back({"regularization", regularization});
  add_term(loss, "gains", gain_prior(state, step_inputs));
  if (state.pattern) {
    add_term(loss, "pattern", state.pattern->mean_square() * options.pattern.prior_weight);
  }
  state.zero_grad();
  std::vector<torch::Tensor> roots;
  for (const torch::Tensor& root : {loss.total, target_part.total, regularization}) {
    if (root.defined()) roots.push_back(root);
  }
  torch::autograd::backward(roots, {});
  apart([&] {
    if (!state.response.adam.empty() && plan.objective.response) state.response.adam.step();
    if (state.poses) state.poses.adam.accumulate(step_inputs.view_pick);
    if (!state.gains.adam.empty()) state.gains.adam.accumulate(step_inputs.view_pick);
    if (state.pattern) state.pattern.adam.step();
  });
  state.gaussian_adam.step(state.gaussians);
  for (losses::NamedTerm& term : loss.terms) term.value = term.value.detach();
  return std::move(loss.terms);
}

}  // namespace jade::train
