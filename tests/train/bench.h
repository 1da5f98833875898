// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "jade/data/dataset.h"
#include "jade/train/bank.h"
#include "jade/train/plan.h"
#include "jade/train/routing_step.h"
#include "jade/train/scene_step.h"
#include "jade/train/step.h"
#include "support/tensors.h"
#include "support/tiny_run.h"

namespace jade::test {

/// Views and a state with a router, without a trainer. The blurry frame replaces F.
struct Bench {
  train::RunOptions options;
  data::Dataset dataset;
  std::vector<train::View> views;
  train::TrainState state;

  train::ViewBank bank;

  explicit Bench(const TinyScene& scene, torch::Device device = torch::kCPU)
      : options(routed_options(scene)) {
    dataset = data::load_dataset(options.dataset);
    prepare(device);
    state = train::make_state(options, dataset, device);
  }

  /// Prepares the bank and views for a router.
  void prepare(torch::Device device) {
    train::RunOptions routed = options;
    routed.objective.target = losses::Target::kRouted;
    bank = train::ViewBank(dataset, routed, device);
    views.clear();
    for (int64_t i = 0; i < bank.size(); ++i) {
      train::View view = bank.step_view(i);
      view.restorations.efnet = view.blurry();
      view.fixed_target = torch::Tensor();
      views.push_back(view);
    }
  }

  train::StepInputs inputs(int64_t view, int64_t step) const {
    const torch::Tensor draws = torch::tensor({1, 2, 3}, torch::kInt64);
    const train::View& chosen = views[static_cast<size_t>(view)];
    const torch::Device device = chosen.measured.device();
    train::StepInputs in;
    in.step = step;
    in.view = chosen;
    in.view_index = view;
    in.pose_draws = draws.to(device);
    in.view_pick = torch::tensor({view}, torch::kInt64).to(device);
    in.edi_factors = bank.edi_factors(view, {1, 2, 3});
    return in;
  }
  train::StepPlan plan(int64_t step) const { return train::plan_step(options, step); }

  train::Renders render(const train::StepInputs& in) {
    return train::render_exposure(state, in, plan(in.step), options);
  }
  train::RouteReport route(const train::StepInputs& in, const train::Renders& renders) {
    return train::routing_step(state, in, train::routing_alpha(state, in, plan(in.step)), renders,
                               plan(in.step), options.route);
  }
  /// Renders and runs the scene step.
  std::vector<losses::NamedTerm> scene_step(const train::StepInputs& in) {
    const torch::Tensor target = train::scene_target(state, in.view, in.view_index);
    return train::scene_step(state, in, render(in), target, plan(in.step), options);
  }
  train::StepOutputs alternate(const train::StepInputs& in) {
    return train::alternate(state, in, plan(in.step), options);
  }
  /// alternate() and the updates after a step.
  train::StepOutputs step(const train::StepInputs& in) {
    train::StepOutputs out = alternate(in);
    train::update_exposures(state, options, in.step);
    return out;
  }
};

/// Replaces the frame of a view for a router.
inline void set_frame(train::View& view, const torch::Tensor& frame) {
  const imaging::SsimTarget target = imaging::ssim_target(frame);
  view.measured = torch::cat({frame, view.measured.narrow(0, 3, 2)});
  view.window_mean = target.mean;
  view.window_square = target.square;
}

/// Makes the Gaussians' scales unequal, so that their rotations have gradients.
inline void stretch(train::TrainState& state) {
  const torch::NoGradGuard no_grad;
  state.gaussians.parameters().log_scales.select(1, 0).add_(0.5);
}

inline std::string names_of(const std::vector<losses::NamedTerm>& terms) {
  std::string names;
  for (const losses::NamedTerm& term : terms) names += term.name + " ";
  return names;
}

/// The tensors of an optimiser by name.
template <class Adam>
std::map<std::string, torch::Tensor> tensors_of(const Adam& adam) {
  std::map<std::string, torch::Tensor> all;
  adam.visit([&](const std::string& name, const torch::Tensor& tensor) { all[name] = tensor; });
  return all;
}

inline std::vector<torch::Tensor> adam_state(const train::TrainState& state) {
  auto all = copies(state.gaussian_adam.first_moments());
  for (const auto& tensor : copies(state.gaussian_adam.second_moments())) all.push_back(tensor);
  all.push_back(state.gaussian_adam.step_count().clone());
  return all;
}

}  // namespace jade::test
