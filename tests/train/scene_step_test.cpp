// SPDX-License-Identifier: Apache-2.0
#include "jade/train/scene_step.h"

#include "support/catch.h"

#include <cmath>
#include <map>
#include <string>
#include <torch/csrc/autograd/autograd.h>

#include "jade/core/error.h"
#include "support/backend_agreement.h"
#include "support/naming.h"
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
  const auto router_adam = [&] {
    std::vector<torch::Tensor> all;
    for (const auto& [name, tensor] : test::tensors_of(bench.state.allocation.adam))
      all.push_back(tensor.clone());
    return all;
  };
  const auto router_adam_before = router_adam();
  const auto scene_before = copies(bench.state.gaussians.parameters());
  const auto target = train::scene_target(bench.state, bench.views[0], 0);
  CHECK_FALSE(target.requires_grad());
  const auto terms =
      train::scene_step(bench.state, inputs, renders, target, bench.plan(1), bench.options);
  CHECK(equal(router_before, copies(bench.state.allocation->parameters())));
  CHECK(equal(router_adam_before, router_adam()));
  CHECK_FALSE(equal(scene_before, copies(bench.state.gaussians.parameters())));
  // target, blur, EDI gray and colour: the others are off during the warm-up
  CHECK(terms.size() == 4);
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

TEST_CASE(
    "scene step: objective.edi_contrast is thresholds so many times as large, for L_edi and "
    "L_sim alone",
    "[train]") {
  const test::TinyScene scene;
  Bench bench(scene);
  bench.options.objective.target = losses::Target::kNone;
  const train::RunOptions usual = bench.options;
  const auto terms_with = [&](double contrast, double thresholds) {
    bench.options.objective.edi_contrast = contrast;
    bench.options.events.threshold_positive = thresholds * bench.options.events.threshold_positive;
    bench.options.events.threshold_negative *= thresholds;
    bench.prepare(torch::kCPU);
    bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
    std::map<std::string, double> values;
    for (const auto& term : bench.scene_step(bench.inputs(1, 9))) {
      values[term.name] = term.value.item<double>();
    }
    return values;
  };
  const auto check = [&](const train::RunOptions& options) {
    const auto with = [&](double contrast, double thresholds) {
      bench.options = options;
      return terms_with(contrast, thresholds);
    };
    const auto plain = with(1, 1), taught = with(1.6, 1), scaled = with(1, 1.6);
    for (const char* name : {"edi_gray", "edi_color", "simulation"}) {
      INFO(name);
      // Factors of another contrast are float16.
      CHECK(taught.at(name) == Approx(scaled.at(name)).epsilon(1e-4));
      CHECK(std::abs(taught.at(name) - plain.at(name)) > 1e-4);
    }
    for (const char* name : {"blur", "intensity"}) {
      CHECK(taught.at(name) == Approx(plain.at(name)).epsilon(1e-6));
    }
  };
  train::RunOptions options = usual;
  options.events.threshold_negative = 0.2;
  for (const auto rule : {geometry::QuadratureRule::kEqual, geometry::QuadratureRule::kTrapezoid}) {
    options.exposure.quadrature = rule;
    check(options);
  }
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
  CHECK_THROWS_NAMING(ContractError, bench.render(inputs), "window");
}

TEST_CASE("scene step: the window of L_ev is rendered with the exposure and as if alone",
          "[train]") {
  const test::TinyScene scene;
  for (const train::PosePath path : {train::PosePath::kNone, train::PosePath::kLinear}) {
    INFO("learned poses: " << (path != train::PosePath::kNone));
    Bench bench(scene);
    bench.options.poses.optimize = path;
    train::learn_poses(bench.state, bench.options.poses, bench.dataset, torch::kCPU);
    const int64_t step = 40;  // densification collects statistics at this step
    train::StepInputs inputs = bench.inputs(1, step);
    const auto counted = [&] {
      const torch::Tensor sum = bench.state.densifier.accumulated().visible_count;
      const torch::Tensor copy = sum.clone();
      sum.zero_();
      return copy;
    };
    const train::Renders without = bench.render(inputs);
    without.color.sum().backward();
    const torch::Tensor count_without = counted();
    REQUIRE(count_without.max().item<float>() > 0);
    CHECK_FALSE(without.window_ends.defined());

    bench.options.objective.event_loss_weight = 0.1;
    inputs.events =
        train::EventWindows(bench.dataset, bench.options.objective, 7, torch::kCPU).at(step, 1);
    const train::Renders with = bench.render(inputs);
    CHECK(with.color.equal(without.color));
    train::StepInputs ends = inputs;
    ends.view.cameras = inputs.events.cameras;
    ends.view.u = inputs.events.u;
    splat::RenderOptions render = train::render_options(bench.options);
    render.sh_degree = bench.plan(step).sh_degree;
    const auto alone = [&](const train::StepInputs& in) {
      const splat::CameraBatch cameras = train::exposure_cameras(bench.state, in);
      return splat::render(bench.state.gaussians.parameters(), cameras, render).color;
    };
    CHECK(with.window_ends.equal(alone(ends)));
    (with.color.sum() + with.window_ends.sum()).backward();
    CHECK(counted().equal(count_without));

    // The gradient of each part is its own.
    const auto gradient = [&](const torch::Tensor& image) {
      return torch::autograd::grad({image.square().sum()},
                                   {bench.state.gaussians.parameters().means}, {},
                                   /*retain_graph=*/true)[0];
    };
    const train::Renders again = bench.render(inputs);
    CHECK(test::cosine(gradient(again.window_ends), gradient(alone(ends))) > 0.999999);
    CHECK(test::cosine(gradient(again.color), gradient(alone(inputs))) > 0.999999);
  }
}
