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
