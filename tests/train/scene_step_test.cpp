// SPDX-License-Identifier: Apache-2.0
#include "jade/train/scene_step.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "train/bench.h"

using namespace jade;
using test::Bench;
using test::copies;
using test::equal;
using test::names_of;

TEST_CASE("scene step: changes the scene and leaves the router and its optimiser bit-equal",
          "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  const train::StepInputs inputs = bench.inputs(0, 1);
  const auto renders = bench.render(inputs);
  const auto router_before = copies(bench.state.allocation->parameters());
  const auto router_adam_before = copies(bench.state.allocation_adam.state());
  const auto scene_before = copies(bench.state.gaussians.parameters());
  const auto target = train::scene_target(bench.state, bench.views[0], 0);
  CHECK_FALSE(target.requires_grad());
  const auto terms =
      train::scene_step(bench.state, inputs, renders, target, bench.plan(1), bench.options);
  CHECK(equal(router_before, copies(bench.state.allocation->parameters())));
  CHECK(equal(router_adam_before, copies(bench.state.allocation_adam.state())));
  CHECK_FALSE(equal(scene_before, copies(bench.state.gaussians.parameters())));
  CHECK(terms.size() == 4);  // target, blur, EDI gray and colour: the others rest in the warm-up
}

TEST_CASE("steps: the calendar decides which terms are there", "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  const auto names_at = [&](int64_t step) {
    return names_of(bench.scene_step(bench.inputs(1, step)));
  };
  CHECK(names_at(4) == "target blur edi_gray edi_color ");
  CHECK(names_at(6) == "target blur edi_gray edi_color intensity ");
  CHECK(names_at(9) == "target blur edi_gray edi_color simulation intensity ");
  bench.options.objective.edi_supervision = false;
  CHECK(names_at(3) == "target blur ");
}

TEST_CASE("scene step: the camera response learns from the terms that read it, and rests without",
          "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  const auto moves_at = [&](int64_t step) {
    const auto before = copies(bench.state.response->parameters());
    bench.scene_step(bench.inputs(1, step));
    return !equal(before, copies(bench.state.response->parameters()));
  };
  CHECK_FALSE(moves_at(4));
  CHECK(moves_at(6));
  bench.options.objective.edi_supervision = bench.options.objective.intensity = false;
  CHECK_FALSE(moves_at(6));
  CHECK(moves_at(9));
  bench.options.objective.simulation = false;
  CHECK_FALSE(moves_at(9));
}

TEST_CASE("scene step: a term that acts and lacks its input is an error", "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  const train::StepInputs inputs = bench.inputs(0, 1);
  const auto renders = bench.render(inputs);
  const auto step = [&](const torch::Tensor& target) {
    train::scene_step(bench.state, inputs, renders, target, bench.plan(1), bench.options);
  };
  CHECK_THROWS_AS(step({}), ContractError);
  bench.options.objective.event_loss_weight = 0.1;
  CHECK_THROWS_WITH(step(bench.views[0].blurry), Catch::Contains("window of events"));
}
