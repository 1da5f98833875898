// SPDX-License-Identifier: Apache-2.0
#include "jade/train/scene_step.h"

#include <torch/types.h>

namespace jade::train {
namespace {

losses::ToneCurve tone_curve(TrainState& state, const losses::ObjectiveOptions& options,
                             int64_t step) {
  if (!state.response || !losses::tone_acts(options, step)) return {};
  const auto table = state.response->table();
  return {[table](const torch::Tensor& image) {
            return response::CameraResponseImpl::apply(image, table);
          },
          [table](const torch::Tensor& images) {
            return response::CameraResponseImpl::mean(images, table);
          }};
}

splat::RenderOptions render_options(int64_t step, const RunOptions& options) {
  splat::RenderOptions render = train::render_options(options);
  render.sh_degree = gaussians::active_sh_degree(step, options.train.sh_degree_every);
  return render;
}

/// Two more renders, at both ends of the window, toned as the sensor's response asks.
losses::EventPair event_pair(const TrainState& state, const EventWindow& window,
                             const losses::ToneCurve& tone, int64_t step,
                             const RunOptions& options) {
  const torch::Tensor images =
      splat::render(state.gaussians.parameters(), window.cameras, render_options(step, options))
          .color;
  const torch::Tensor toned = tone.apply ? tone.apply(images) : images;
  const events::Thresholds thresholds = options.events.thresholds();
  losses::EventPair pair;
  pair.before = toned[0];
  pair.after = toned[1];
  pair.counts = window.counts;
  pair.pixels = window.pixels;
  pair.color_filter = window.color_filter;
  pair.threshold_positive = thresholds.positive;
  pair.threshold_negative = thresholds.negative;
  pair.weighted_colors = losses::tone_acts(options.objective, step);
  return pair;
}

void step_poses(TrainState& state, int64_t step, const PoseOptions& options) {
  if (state.poses_adam.empty() || step % options.accumulate != 0) return;
  state.poses_adam.step(pose_lr(options, step));
  state.poses_adam.zero_grad();
}

}  // namespace

splat::CameraBatch exposure_cameras(const TrainState& state, const View& view, int64_t view_index) {
  splat::CameraBatch cameras = view.cameras;
  if (state.poses) {
    cameras.camera_from_world =
        state.poses->forward(view_index, cameras.camera_from_world.device());
  }
  return cameras;
}

Renders render_exposure(TrainState& state, const View& view, int64_t view_index,
                        const torch::Tensor& draws, int64_t step, const RunOptions& options) {
  splat::RenderOptions render = render_options(step, options);
  render.statistics = state.densifier.statistics(step);
  render.statistics_view = state.densifier.statistics_view();
  splat::CameraBatch cameras = exposure_cameras(state, view, view_index);
  const torch::Tensor read = losses::poses_read(options.objective, step, draws);
  if (read.defined()) {
    cameras.camera_from_world = cameras.camera_from_world.index_select(0, read);
    cameras.intrinsics = cameras.intrinsics.index_select(0, read);
  }
  return {splat::render(state.gaussians.parameters(), cameras, render).color};
}

std::vector<losses::NamedTerm> scene_step(TrainState& state, const SceneStepInputs& step_inputs,
                                          int64_t step, const RunOptions& options) {
  const View& view = step_inputs.view;
  losses::ObjectiveInputs inputs;
  inputs.renders = step_inputs.renders.color;
  inputs.blurry = view.blurry;
  inputs.blurry_moments = view.blurry_moments;
  inputs.edi_factors = view.edi_factors;
  inputs.poses = step_inputs.poses;
  if (step_inputs.target.defined()) inputs.target.emplace(step_inputs.target);
  inputs.tone = tone_curve(state, options.objective, step);
  if (step_inputs.events.defined()) {
    inputs.events = event_pair(state, step_inputs.events, inputs.tone, step, options);
  }

  losses::Objective loss = losses::objective(inputs, step, options.objective);
  const torch::Tensor regularization = state.densifier.regularization(state.gaussians);
  if (regularization.defined()) {
    loss.total = loss.total.defined() ? loss.total + regularization : regularization;
    loss.terms.push_back({"regularization", regularization});
  }
  state.gaussians.zero_grad();
  state.response_adam.zero_grad();
  loss.total.backward();
  state.gaussian_adam.step(state.gaussians);
  if (!state.response_adam.empty() && losses::tone_acts(options.objective, step))
    state.response_adam.step();
  step_poses(state, step, options.poses);
  for (losses::NamedTerm& term : loss.terms) term.value = term.value.detach();
  return std::move(loss.terms);
}

}  // namespace jade::train
