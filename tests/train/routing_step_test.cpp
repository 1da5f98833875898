// SPDX-License-Identifier: Apache-2.0
#include "jade/train/routing_step.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>

#include "jade/train/step_feed.h"
#include "train/bench.h"

using namespace jade;
using test::adam_state;
using test::Bench;
using test::copies;
using test::equal;

TEST_CASE("routing step: changes the router and leaves the scene and its optimiser bit-equal",
          "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  const train::StepInputs inputs = bench.inputs(0, 1);
  const auto renders = bench.render(inputs);
  CHECK(renders.color.size(0) == 9);
  const auto scene_before = copies(bench.state.gaussians.parameters());
  const auto adam_before = adam_state(bench.state);
  const auto router_before = copies(bench.state.allocation->parameters());
  const auto report = bench.route(inputs, renders);
  CHECK(equal(scene_before, copies(bench.state.gaussians.parameters())));
  CHECK(equal(adam_before, adam_state(bench.state)));
  CHECK_FALSE(bench.state.gaussians.gradients().means.defined());
  CHECK_FALSE(equal(router_before, copies(bench.state.allocation->parameters())));
  CHECK(report.render.defined());
  CHECK_FALSE(report.render.requires_grad());
}

TEST_CASE("routing step: where both restorations agree no gradient reaches the allocation, Eq. (5)",
          "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  train::StepInputs inputs = bench.inputs(0, 1);
  inputs.view.restorations.efnet = inputs.view.restorations.edi;
  const auto renders = bench.render(inputs);
  const auto before = copies(bench.state.allocation->parameters());
  bench.route(inputs, renders);
  CHECK(equal(before, copies(bench.state.allocation->parameters())));
}

TEST_CASE("routing step: on one view leaves the maps of the others and their Adam bit-equal",
          "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  bench.options.allocation.kind = router::AllocationKind::kPerViewMap;
  bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
  const auto maps = bench.state.allocation->parameters();
  const auto step_on = [&](int64_t index) {
    const train::StepInputs inputs = bench.inputs(index, 1);
    bench.route(inputs, bench.render(inputs));
  };
  const auto alpha_of = [&](int64_t index) {
    return train::allocation_map(bench.state, bench.views[static_cast<size_t>(index)], index);
  };
  /// A view's map, its two moments and its step count.
  const auto state_of = [&](size_t view) {
    const auto adam = test::tensors_of(bench.state.allocation.adam);
    REQUIRE(adam.size() == 9);
    const auto of = [&](const char* name) { return adam.at(concat(name, view)); };
    return copies(
        std::vector<torch::Tensor>{maps[view], of("first."), of("second."), of("steps.")});
  };
  const torch::Tensor untouched = alpha_of(2);
  step_on(0);
  const torch::Tensor of_0 = alpha_of(0), of_1 = alpha_of(1);
  CHECK_FALSE(of_0.equal(untouched));
  step_on(1);
  step_on(1);
  CHECK(alpha_of(0).equal(of_0));
  CHECK(alpha_of(2).equal(untouched));
  CHECK_FALSE(alpha_of(1).equal(of_1));
  const auto of_view_0 = state_of(0), of_view_1 = state_of(1);
  CHECK(of_view_0[3].item<double>() == 1);
  CHECK(of_view_1[3].item<double>() == 2);
  step_on(1);
  CHECK(equal(state_of(0), of_view_0));
  CHECK_FALSE(equal(state_of(1), of_view_1));
  CHECK_FALSE(maps[0].grad().defined());
}

namespace {

/// A scene with restorations at every pose, in float64 except for the renders.
struct DrawnRouting {
  test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  data::Dataset dataset = data::load_dataset(options.dataset);
  train::StepFeed feed{dataset, options, torch::kCPU};
  train::TrainState state = train::make_state(options, dataset, torch::kCPU);
  train::Renders renders;
  train::StepInputs inputs;

  explicit DrawnRouting(int64_t pose) {
    int64_t step = 1;
    while (feed.at(step).pose_draws[3].item<int64_t>() != pose) ++step;
    inputs = feed.at(step);
    const train::StepPlan plan = train::plan_step(options, step);
    const torch::NoGradGuard no_grad;
    renders = train::render_exposure(state, inputs, plan, options);
    renders.color = renders.color.to(torch::kFloat64);
    inputs.view.visit([](const std::string&, torch::Tensor& tensor) {
      if (tensor.defined() && tensor.is_floating_point()) tensor = tensor.to(torch::kFloat64);
    });
    state.allocation->to(torch::kFloat64);
    state.allocation.adam = train::ModuleAdam(state.allocation->parameters(), 1e-12);
  }

  /// Eq. (6) at a pose, written out.
  double loss_at(int64_t pose) {
    const torch::NoGradGuard no_grad;
    const train::View& view = inputs.view;
    const auto alpha = state.allocation->forward(view.measured, inputs.view_index);
    const auto pseudo = alpha * view.restorations.edi + (1 - alpha) * view.restorations.efnet;
    return ((pseudo - renders.color[pose]).abs().mean() +
            (pseudo * view.reblur_kernel - view.blurry()).abs().mean())
        .item<double>();
  }
};

}  // namespace

TEST_CASE("routing step: at a drawn pose the gradient is that of Eq. (6) there", "[train]") {
  constexpr int64_t kPose = 7;
  DrawnRouting routing(kPose);
  train::StepPlan plan = train::plan_step(routing.options, routing.inputs.step);
  REQUIRE(plan.objective.drawn_target);
  routing.state.allocation.adam.zero_grad();
  const auto report = train::routing_step(routing.state, routing.inputs,
                                          train::routing_alpha(routing.state, routing.inputs, plan),
                                          routing.renders, plan, routing.options.route);
  CHECK(report.render.item<double>() + report.reblur.item<double>() ==
        Approx(routing.loss_at(kPose)).epsilon(1e-6));
  const torch::NoGradGuard no_grad;
  double worst = 0, elsewhere = 0;
  int64_t checked = 0;
  for (torch::Tensor& parameter : routing.state.allocation->parameters()) {
    const torch::Tensor gradient = parameter.grad().flatten();
    const torch::Tensor values = parameter.view({-1});
    const double largest = gradient.abs().max().item<double>();
    const int64_t i = gradient.abs().argmax().item<int64_t>();
    const double start = values[i].item<double>(), step = 1e-7;
    const auto slope = [&](int64_t pose) {
      values[i] = start + step;
      const double above = routing.loss_at(pose);
      values[i] = start - step;
      const double below = routing.loss_at(pose);
      values[i] = start;
      return (above - below) / (2 * step);
    };
    const double analytic = gradient[i].item<double>();
    worst = std::max(worst, std::abs(slope(kPose) - analytic) / largest);
    elsewhere = std::max(elsewhere, std::abs(slope(4) - analytic) / largest);
    ++checked;
  }
  CHECK(checked >= 7);
  CHECK(worst < 1e-4);
  CHECK(elsewhere > 1e-2);  // the gradient of the middle differs
}

TEST_CASE("routing step: rests where the plan has none", "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  const train::StepInputs inputs = bench.inputs(0, 1);
  const auto renders = bench.render(inputs);
  const auto before = copies(bench.state.allocation->parameters());
  train::StepPlan plan = bench.plan(1);
  REQUIRE(plan.route);
  plan.route = false;
  const torch::Tensor alpha = train::routing_alpha(bench.state, inputs, plan);
  CHECK_FALSE(alpha.defined());
  const auto report =
      train::routing_step(bench.state, inputs, alpha, renders, plan, bench.options.route);
  CHECK_FALSE(report.render.defined());
  CHECK(equal(before, copies(bench.state.allocation->parameters())));
}
