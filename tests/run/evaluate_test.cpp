// SPDX-License-Identifier: Apache-2.0
#include "jade/run/evaluate.h"

#include "support/catch.h"

#include <array>
#include <torch/types.h>

#include "jade/data/dataset.h"
#include "jade/train/state.h"
#include "jade/train/view.h"
#include "support/tiny_run.h"

using namespace jade;

TEST_CASE("evaluation: a held-out frame is compared with the weighted mean of its quadrature",
          "[run]") {
  const test::TinyScene scene;
  const train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto gaussians = train::make_state(options, dataset, torch::kCPU).gaussians.detached();
  const splat::RenderOptions draw = train::render_options(options);
  data::Exposure held_out = dataset.train[1];
  const auto mean_of = [&](const std::vector<double>& weights) {
    torch::Tensor sum = torch::zeros_like(held_out.blurry);
    for (size_t k = 0; k < 9; ++k)
      sum += weights[k] * run::render_view(gaussians, held_out.poses[k], held_out.camera, draw);
    return sum;
  };
  const double end = 1.0 / 16, inner = 1.0 / 8, even = 1.0 / 9;
  const torch::Tensor trapezoid =
      mean_of({end, inner, inner, inner, inner, inner, inner, inner, end});
  const torch::Tensor equal = mean_of({even, even, even, even, even, even, even, even, even});
  const auto psnr = [&](geometry::QuadratureRule rule, const torch::Tensor& blurry) {
    held_out.blurry = blurry;
    return run::evaluate_held_out(gaussians, {held_out}, {rule, 9}, draw).at(0).psnr_reblur;
  };
  CHECK(psnr(geometry::QuadratureRule::kTrapezoid, trapezoid) > 99);
  CHECK(psnr(geometry::QuadratureRule::kTrapezoid, equal) < 80);
  CHECK(psnr(geometry::QuadratureRule::kEqual, equal) > 99);
}

TEST_CASE("evaluation: a view is scored as bright as its gain says, or as suits it best", "[run]") {
  const test::TinyScene scene;
  const train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto gaussians = train::make_state(options, dataset, torch::kCPU).gaussians.detached();
  const splat::RenderOptions draw = train::render_options(options);
  data::SharpView view = dataset.test[0];
  view.image = 0.5 * run::render_view(gaussians, view.pose, view.camera, draw);
  const eval::Lpips none(torch::kCPU, scene.dir / "none");
  const auto scored = [&](double gain, bool fit) {
    view.gain = gain;
    return run::evaluate_views(gaussians, {view}, none, draw, fit).views.at(0);
  };
  CHECK(scored(1, false).psnr < 40);
  CHECK_FALSE(scored(1, false).gain);
  CHECK(scored(0.5, false).psnr > 99);
  const eval::Scores fitted = scored(1, true);
  CHECK(fitted.psnr > 90);
  CHECK(fitted.gain.value() == Approx(0.5).epsilon(1e-4));
  data::Exposure held_out = dataset.train[1];
  held_out.poses.fill(view.pose);
  held_out.blurry = view.image;
  const auto reblurred = [&](bool fit) {
    return run::evaluate_held_out(gaussians, {held_out}, options.exposure, draw, fit)
        .at(0)
        .psnr_reblur;
  };
  CHECK(reblurred(false) < 40);
  CHECK(reblurred(true) > 90);
}

TEST_CASE("evaluation: pixels that a mask excludes count in no score", "[run]") {
  const test::TinyScene scene;
  const train::RunOptions options = test::tiny_options(scene);
  data::Dataset dataset = data::load_dataset(options.dataset);
  const auto gaussians = train::make_state(options, dataset, torch::kCPU).gaussians.detached();
  dataset.held_out = {dataset.train[1]};
  REQUIRE_FALSE(dataset.test.empty());
  dataset.test.resize(1);
  data::SharpView& view = dataset.test[0];
  data::Exposure& held_out = dataset.held_out[0];
  const eval::Lpips lpips(torch::kCPU, scene.dir.path());
  const auto scores = [&] {
    const eval::Evaluation e = run::evaluate_dataset(gaussians, dataset, lpips, options);
    return std::array{e.views[0].psnr, e.views[0].psnr_channel_mean, e.views[0].ssim,
                      *e.mean.psnr_reblur};
  };
  view.mask = torch::ones({1, view.camera.height, view.camera.width}, torch::kBool);
  view.mask.slice(2, 0, view.camera.width / 2).fill_(false);
  held_out.mask = view.mask;
  const auto before = scores();
  view.image = view.image.clone();
  held_out.blurry = held_out.blurry.clone();
  view.image.slice(2, 0, view.camera.width / 2).fill_(1);
  held_out.blurry.slice(2, 0, view.camera.width / 2).fill_(1);
  CHECK(scores() == before);
  view.mask = held_out.mask = torch::Tensor();
  const auto without = scores();
  for (size_t i = 0; i < before.size(); ++i) CHECK(without[i] != before[i]);
}
