// SPDX-License-Identifier: Apache-2.0
#include "jade/train/exposure_gains.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "train/bench.h"

using namespace jade;

namespace {

data::Dataset with_gains(const data::Dataset& dataset, const std::vector<double>& gains) {
  data::Dataset out = dataset;
  for (size_t i = 0; i < gains.size(); ++i) out.train[i].gain = gains[i];
  return out;
}

}  // namespace

TEST_CASE("gains: learned where they differ or are asked for, kept where they are given",
          "[train]") {
  const test::TinyScene scene;
  const data::Dataset plain = data::load_dataset(test::tiny_options(scene).dataset);
  const data::Dataset given = with_gains(plain, {2, 1, 0.5});
  train::GainOptions options;
  CHECK_FALSE(train::learns_gains(options, plain));
  CHECK(train::make_exposure_gains(options, plain) == nullptr);
  CHECK_FALSE(train::learns_gains(options, with_gains(plain, {2, 2, 2})));
  CHECK(train::make_exposure_gains(options, given)->learned());
  options.optimize = train::LearnGains::kOff;
  const auto kept = train::make_exposure_gains(options, given);
  CHECK_FALSE(kept->learned());
  CHECK(kept->range().first == Approx(0.5));
  CHECK(kept->range().second == Approx(2));
  CHECK(kept->forward(torch::tensor({2}, torch::kInt64)).item<float>() == Approx(0.5));
  options.optimize = train::LearnGains::kOn;
  CHECK(train::make_exposure_gains(options, plain)->learned());
}

TEST_CASE("gains: the prior pulls to the data's, and what all have in common is taken out",
          "[train]") {
  const test::TinyScene scene;
  const data::Dataset given =
      with_gains(data::load_dataset(test::tiny_options(scene).dataset), {2, 1, 0.5});
  train::ExposureGains gains(given, true);
  const torch::Tensor before = gains.log_gains().detach().clone();
  {
    const torch::NoGradGuard no_grad;
    torch::Tensor logs = gains.log_gains();
    logs.add_(torch::tensor({0.3, 0.0, 0.0}, torch::kFloat64).unsqueeze(1));
  }
  CHECK(gains.squared_change(torch::tensor({0}, torch::kInt64)).item<float>() == Approx(0.09));
  CHECK(gains.squared_change(torch::tensor({1}, torch::kInt64)).item<float>() == 0);
  gains.hold_mean();
  const torch::Tensor change = gains.log_gains().detach() - before;
  CHECK(std::abs(change.sum().item<double>()) < 1e-12);
  CHECK(change[0].item<double>() == Approx(0.2));
}

TEST_CASE("gains: renders are as bright as their frame, and a brighter frame raises its gain",
          "[train]") {
  const test::TinyScene scene;
  test::Bench bench(scene);
  const torch::Tensor plain = bench.render(bench.inputs(1, 1)).color.detach();
  bench.options.gains.optimize = train::LearnGains::kOn;
  bench.options.gains.lr = 0.01;
  bench.options.objective.target = losses::Target::kNone;
  bench.dataset = with_gains(bench.dataset, {1, 1.5, 1});
  // Gains change the first colours, so this is the scene from before.
  const gaussians::GaussianModel scene_before = bench.state.gaussians;
  bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
  bench.state.gaussians = scene_before;
  const torch::Tensor brighter = bench.render(bench.inputs(1, 1)).color.detach();
  CHECK(torch::allclose(brighter, 1.5 * plain, 1e-5, 1e-6));
  CHECK(bench.render(bench.inputs(0, 1))
            .color.detach()
            .equal(test::Bench(scene).render(bench.inputs(0, 1)).color.detach()));

  // Starts from equal gains with a fixed scene; frames are two thirds, three halves and exactly as
  // bright as its renders.
  losses::ObjectiveOptions& terms = bench.options.objective;
  terms.edi_supervision = terms.simulation = terms.intensity = false;
  gaussians::OptimOptions& optim = bench.options.optim;
  for (double* lr : {&optim.position_lr_start, &optim.sh_dc_lr, &optim.sh_rest_lr,
                     &optim.opacity_lr, &optim.scale_lr, &optim.rotation_lr}) {
    *lr = 1e-20;
  }
  bench.options.gains.lr = 0.02;
  bench.dataset = with_gains(bench.dataset, {1, 1, 1});
  bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
  for (const auto& [view, brightness] : {std::pair{0, 2.0 / 3}, {1, 1.5}, {2, 1.0}}) {
    test::set_frame(bench.views[static_cast<size_t>(view)],
                    brightness * bench.render(bench.inputs(view, 1)).color.detach().mean(0));
  }
  for (int64_t step = 1; step <= 30; ++step) bench.step(bench.inputs(step % 3, step));
  const torch::Tensor logs = bench.state.gains->log_gains().detach();
  INFO(logs);
  CHECK(logs[0].item<double>() < -0.1);
  CHECK(logs[1].item<double>() > 0.1);
  CHECK(std::abs(logs.sum().item<double>()) < 1e-9);

  bench.options.gains.lr = 0;
  bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
  bench.step(bench.inputs(1, 1));
  CHECK(bench.state.gains->log_gains().abs().max().item<double>() == 0);
}
