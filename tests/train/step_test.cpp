// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step.h"

#include "support/catch.h"

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

TEST_CASE("steps: poses move by the step size of their own step", "[train]") {
  const test::TinyScene scene;
  for (const auto& [step, rate] : {std::pair{1, 1e-4}, {2, 1e-6}, {3, 1e-6}}) {
    Bench bench(scene);
    train::PoseOptions& poses = bench.options.poses;
    poses.optimize = train::PosePath::kLinear;
    poses.start = train::PoseStart::kLine;
    poses.lr = 1e-2, poses.lr_final = 1e-6, poses.lr_max_steps = 2;
    bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
    bench.step(bench.inputs(1, step));
    // Adam's first update moves by the step size, whatever the gradient.
    CHECK(bench.state.poses->twists().abs().max().item<double>() == Approx(rate).epsilon(0.01));
  }
}
