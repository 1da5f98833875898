// SPDX-License-Identifier: Apache-2.0
#include "jade/train/routing_step.h"

#include "support/catch.h"

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
    const auto adam = bench.state.allocation_adam.state();
    REQUIRE(adam.size() == 9);
    return copies(
        std::vector<torch::Tensor>{maps[view], adam[view], adam[3 + view], adam[6 + view]});
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

TEST_CASE("routing step: rests where the plan has none", "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  const train::StepInputs inputs = bench.inputs(0, 1);
  const auto renders = bench.render(inputs);
  const auto before = copies(bench.state.allocation->parameters());
  train::StepPlan plan = bench.plan(1);
  REQUIRE(plan.route);
  plan.route = false;
  const auto report = train::routing_step(bench.state, inputs, renders, plan, bench.options.route);
  CHECK_FALSE(report.render.defined());
  CHECK(equal(before, copies(bench.state.allocation->parameters())));
}
