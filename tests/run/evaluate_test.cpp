// SPDX-License-Identifier: Apache-2.0
#include "jade/run/evaluate.h"

#include "support/catch.h"

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
