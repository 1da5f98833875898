// SPDX-License-Identifier: Apache-2.0
#include "jade/train/scene_step.h"

#include <torch/torch.h>

namespace jade::train {
namespace {

losses::ToneCurve tone_curve(TrainState& state, const losses::SceneLossOptions& options,
                             int64_t step) {
  if (!state.crf || !losses::tone_acts(options, step)) return {};
  const auto table = state.crf->table();
  return {[table](const torch::Tensor& image) { return models::CrfImpl::apply(image, table); },
          [table](const torch::Tensor& images) { return models::CrfImpl::mean(images, table); }};
}

}  // namespace

Renders render_exposure(TrainState& state, const View& view, int64_t step,
                        const RunOptions& options) {
  splat::RenderOptions render;
  render.sh_degree = scene::active_sh_degree(step, options.train.sh_degree_every);
  render.deterministic = options.deterministic;
  render.statistics = state.densifier.statistics(step);
  render.statistics_view = state.densifier.statistics_view();
  return {splat::render(state.gaussians.parameters(), view.cameras, render).color};
}

std::vector<losses::NamedTerm> scene_step(TrainState& state, const View& view,
                                          const Renders& renders, const torch::Tensor& target,
                                          const torch::Tensor& poses, int64_t step,
                                          const RunOptions& options) {
  losses::SceneLossInputs inputs;
  inputs.renders = renders.color;
  inputs.blurry = view.blurry;
  inputs.blurry_moments = view.blurry_moments;
  inputs.edi_factors = view.edi_factors;
  inputs.poses = poses;
  if (target.defined()) inputs.target.emplace(target);
  inputs.tone = tone_curve(state, options.scene, step);

  losses::SceneLoss loss = losses::scene_loss(inputs, step, options.scene);
  const torch::Tensor regularization = state.densifier.regularization(state.gaussians);
  if (regularization.defined()) {
    loss.total = loss.total.defined() ? loss.total + regularization : regularization;
    loss.terms.push_back({"regularization", regularization});
  }
  state.gaussians.zero_grad();
  state.crf_adam.zero_grad();
  loss.total.backward();
  state.gaussian_adam.step(state.gaussians);
  if (!state.crf_adam.empty() && losses::tone_acts(options.scene, step)) state.crf_adam.step();
  if (state.densifier.due(step)) state.densifier.update(step, state.gaussians, state.gaussian_adam);
  for (losses::NamedTerm& term : loss.terms) term.value = term.value.detach();
  return std::move(loss.terms);
}

}  // namespace jade::train
