// SPDX-License-Identifier: Apache-2.0
#include "jade/train/fixed_pattern.h"

#include "support/catch.h"

#include <torch/types.h>

#include "train/bench.h"

using namespace jade;

TEST_CASE("pattern: none where it is not learned or frames have several sizes", "[train]") {
  const test::TinyScene scene;
  data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  train::PatternOptions options;
  options.learn = train::LearnPattern::kOn;
  const auto& camera = dataset.train[0].camera;
  CHECK((train::make_fixed_pattern(options, dataset)->offsets().sizes() ==
         torch::IntArrayRef{3, camera.height, camera.width}));
  dataset.monochrome = true;
  CHECK(train::make_fixed_pattern(options, dataset)->offsets().size(0) == 1);
  dataset.train[1].camera.width += 1;
  CHECK(train::make_fixed_pattern(options, dataset) == nullptr);
  dataset.train[1].camera.width -= 1;
  options.learn = train::LearnPattern::kOff;
  CHECK(train::make_fixed_pattern(options, dataset) == nullptr);
}

TEST_CASE("pattern: what all frames have at the same pixels is learned, and the prior holds it",
          "[train]") {
  const test::TinyScene scene;
  test::Bench bench(scene);
  bench.options.pattern = {train::LearnPattern::kOn, 1e-3, 0.5};
  losses::ObjectiveOptions& terms = bench.options.objective;
  terms.target = losses::Target::kNone;
  terms.edi_supervision = terms.simulation = terms.intensity = false;
  gaussians::OptimOptions& optim = bench.options.optim;
  for (double* lr : {&optim.position_lr_start, &optim.sh_dc_lr, &optim.sh_rest_lr,
                     &optim.opacity_lr, &optim.scale_lr, &optim.rotation_lr}) {
    *lr = 1e-20;
  }
  bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
  // Frames are the renders of a fixed scene, with a brighter column.
  for (int64_t view = 0; view < 3; ++view) {
    const torch::Tensor frame = bench.render(bench.inputs(view, 1)).color.detach().mean(0);
    frame.select(2, 5).add_(0.03);
    test::set_frame(bench.views[static_cast<size_t>(view)], frame);
  }
  const auto train = [&](double prior) {
    bench.options.pattern.prior_weight = prior;
    bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
    for (int64_t step = 1; step <= 60; ++step) bench.step(bench.inputs(step % 3, step));
    return bench.state.pattern->offsets().detach().flatten(0, 1).mean(0);
  };
  const torch::Tensor found = train(0.5), held = train(1e3);
  INFO(found);
  CHECK(found[5].item<double>() == Approx(0.03).margin(0.006));
  CHECK(found[4].abs().item<double>() < 0.006);
  CHECK(found[20].abs().item<double>() < 0.004);
  CHECK(held.abs().max().item<double>() < 0.004);
}
