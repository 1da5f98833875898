// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step.h"

#include "support/catch.h"

#include <algorithm>

#include "jade/train/step_feed.h"
#include "jade/train/step_graph.h"
#include "support/backend_agreement.h"
#include "train/bench.h"

using namespace jade;
using test::Bench;
using test::copies;
using test::equal;
using test::names_of;

TEST_CASE("steps: after target_until the target and the routing step rest", "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  bench.options.objective.target_until = 2;
  const auto names_at = [&](int64_t step) {
    return names_of(bench.alternate(bench.inputs(1, step)).terms);
  };
  CHECK(names_at(2) == "target blur edi_gray edi_color route_render route_reblur ");
  const auto router = copies(bench.state.allocation->parameters());
  const auto scene_before = copies(bench.state.gaussians.parameters());
  CHECK(names_at(3) == "blur edi_gray edi_color ");
  CHECK(equal(copies(bench.state.allocation->parameters()), router));
  CHECK_FALSE(equal(copies(bench.state.gaussians.parameters()), scene_before));
}

TEST_CASE("steps: poses without gradient are not rendered and do not dilute the densification",
          "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  bench.options.objective.target = losses::Target::kEdi;
  bench.options.objective.blur = bench.options.objective.edi_supervision = false;
  bench.options.objective.simulation = bench.options.objective.intensity = false;
  bench.views[1].fixed_target = bench.views[1].restorations.edi;
  const auto out = bench.alternate(bench.inputs(1, 1));
  CHECK(out.renders.color.size(0) == 1);
  const splat::ScreenStatistics& seen = bench.state.densifier.accumulated();
  CHECK(seen.visible_count.max().item<float>() == 1);
  CHECK(seen.gradient_norm.max().item<float>() > 0);
}

TEST_CASE("steps: concurrent work on a GPU moves the scene as work in sequence", "[train][cuda]") {
  const torch::Device gpu(torch::kCUDA, 0);
  const train::StreamScope stream(gpu);
  const test::TinyScene scene;
  const auto first_moments = [&](bool concurrent) {
    Bench bench(scene, gpu);
    test::stretch(bench.state);
    const train::StepInputs inputs = bench.inputs(1, 9);
    if (concurrent) {
      bench.alternate(inputs);
    } else {
      const train::Renders renders = bench.render(inputs);
      bench.route(inputs, renders);
      train::scene_step(bench.state, inputs, renders,
                        train::scene_target(bench.state, inputs.view, 1), bench.plan(9),
                        bench.options);
    }
    std::vector<torch::Tensor> moments = copies(bench.state.gaussian_adam.first_moments());
    for (torch::Tensor& each : moments) each = each.cpu();
    return moments;
  };
  test::check_gradients(first_moments(true), first_moments(false));
}

TEST_CASE("steps: poses move by the step size of their own step", "[train]") {
  const test::TinyScene scene;
  for (const auto& [step, rate] : {std::pair{1, 1e-3}, {2, 1e-4}, {3, 1e-4}}) {
    Bench bench(scene);
    train::PoseOptions& poses = bench.options.poses;
    poses.optimize = train::PosePath::kLinear;
    poses.start = train::PoseStart::kLine;
    poses.lr = 1e-2, poses.lr_max_steps = 2;
    bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
    bench.step(bench.inputs(1, step));
    // Adam's first update moves by the step size, whatever the gradient.
    CHECK(bench.state.poses->twists().abs().max().item<double>() == Approx(rate).epsilon(0.01));
  }
}

namespace {

/// The training exposures with `fill` in their left third, masked or not.
data::Dataset filled(const data::Dataset& dataset, double fill, bool masks) {
  data::Dataset out = dataset;
  for (data::Exposure& exposure : out.train) {
    exposure.blurry = exposure.blurry.clone();
    exposure.blurry.narrow(2, 0, 12).fill_(fill);
    if (!masks) continue;
    exposure.mask =
        torch::ones({1, exposure.blurry.size(1), exposure.blurry.size(2)}, torch::kBool);
    exposure.mask.narrow(2, 0, 12).fill_(false);
  }
  return out;
}

}  // namespace

TEST_CASE("steps: what lies under a mask changes no bit of scene, router and response", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::full_options(scene);
  options.cache.enabled = false;
  options.gains.optimize = train::LearnGains::kOn;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto trained = [&](double fill, bool masks) {
    train::StepFeed feed(filled(dataset, fill, masks), options, torch::kCPU);
    train::TrainState state = train::make_state(options, dataset, torch::kCPU);
    for (int64_t step = 10; step <= 16; ++step) {
      train::alternate(state, feed.at(step), train::plan_step(options, step), options);
      train::update_exposures(state, options, step);
    }
    std::vector<torch::Tensor> all;
    state.visit([&](const std::string&, const torch::Tensor& tensor) {
      if (tensor.defined()) all.push_back(tensor.detach().clone());
    });
    return all;
  };
  CHECK(equal(trained(0.2, true), trained(0.9, true)));
  CHECK_FALSE(equal(trained(0.2, false), trained(0.9, false)));
}

TEST_CASE("steps: under a mask of the whole frame there is neither loss nor gradient", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::full_options(scene);
  options.cache.enabled = false;
  data::Dataset dataset = data::load_dataset(options.dataset);
  const auto largest = [&](bool masked) {
    for (data::Exposure& exposure : dataset.train) {
      exposure.mask = masked ? torch::zeros({1, 28, 36}, torch::kBool) : torch::Tensor();
    }
    train::StepFeed feed(dataset, options, torch::kCPU);
    train::TrainState state = train::make_state(options, dataset, torch::kCPU);
    const int64_t step = 20;  // every term acts
    const train::StepOutputs out =
        train::alternate(state, feed.at(step), train::plan_step(options, step), options);
    double loss = 0, gradient = 0;
    for (const auto& term : out.terms) loss = std::max(loss, term.value.abs().item<double>());
    const auto look = [&](const torch::Tensor& parameter) {
      if (!parameter.grad().defined()) return;
      gradient = std::max(gradient, parameter.grad().abs().max().item<double>());
    };
    look(state.gaussians.parameters().means);
    look(state.gaussians.parameters().sh);
    for (const torch::Tensor& each : state.response->parameters()) look(each);
    for (const torch::Tensor& each : state.allocation->parameters()) look(each);
    return std::pair(loss, gradient);
  };
  const auto [loss, gradient] = largest(true);
  CHECK(loss < 1e-6);
  CHECK(gradient == 0);
  CHECK(largest(false).first > 1e-3);
  CHECK(largest(false).second > 0);
}
