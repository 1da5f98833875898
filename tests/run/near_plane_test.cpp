// SPDX-License-Identifier: Apache-2.0
// A run's training, scores and pictures use one near plane, and so does resuming it.
#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/data/dataset.h"
#include "jade/imaging/image_io.h"
#include "jade/run/evaluate.h"
#include "jade/run/trainer.h"
#include "jade/train/scene_step.h"
#include "jade/train/view.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

/// Depths between 1 and 2.1.
struct ShortRun : test::TinyScene {
  train::RunOptions options;
  std::filesystem::path run = dir.path() / "run";

  ShortRun() {
    options = test::tiny_options(*this);
    options.densify.strategy = gaussians::DensifyStrategy::kNone;
    options.train.calendar = 0;
    options.train.iterations = 3;
  }
};

}  // namespace

TEST_CASE("near plane: training, scores and pictures cut where the run says", "[run]") {
  ShortRun scene;
  // The whole scene is nearer than this near plane, so the render is empty.
  scene.options.splat.near_plane = 50;
  run::Trainer trainer(scene.options, scene.run, "");
  auto& state = const_cast<train::TrainState&>(trainer.state());
  train::StepInputs inputs;
  inputs.view = trainer.bank().step_view(0);
  inputs.pose_draws = torch::zeros({3}, torch::kInt64);
  const auto render = [&] {
    const train::StepPlan plan = train::plan_step(scene.options, 1);
    return train::render_exposure(state, inputs, plan, scene.options).color;
  };
  CHECK(render().abs().max().item<float>() == 0);
  scene.options.splat.near_plane = 0.2;
  CHECK(render().max().item<float>() > 0.1F);

  trainer.run();
  CHECK(imaging::read_image(scene.run / "images/train_00.png").max().item<float>() == 0);
  CHECK(imaging::read_image(scene.run / "images/test_03.png").max().item<float>() == 0);
  // Both the run and programs that open it score black images.
  const train::RunOptions saved = run::load_run_options(scene.run);
  CHECK(saved.splat.near_plane == 50);
  const run::FinishedRun opened = run::open_run(scene.run, saved);
  const eval::Lpips lpips(torch::kCPU);
  const auto scores = run::evaluate_views(opened.gaussians, opened.dataset.test, lpips,
                                          train::render_options(saved));
  CHECK(scores.mean.psnr == trainer.evaluate().mean.psnr);
  const auto& truth = opened.dataset.test[0].image;
  CHECK(scores.views[0].psnr == Approx(-10 * std::log10(truth.square().mean().item<double>())));
}

TEST_CASE("near plane: a run writes what it decided, and keeps it on resume", "[run]") {
  ShortRun scene;
  run::Trainer(scene.options, scene.run, "").run();
  CHECK(run::load_run_options(scene.run).splat.near_plane == 0.2);
  scene.options.train.iterations = 5;
  run::Trainer(scene.options, scene.run, "latest").run();
  CHECK(run::load_run_options(scene.run).splat.near_plane == 0.2);
  scene.options.splat.near_plane = 0.2;
  CHECK_NOTHROW(run::Trainer(scene.options, scene.run, "latest"));
  scene.options.splat.near_plane = 0.3;
  CHECK_THROWS_WITH(run::Trainer(scene.options, scene.run, "latest"),
                    Catch::Contains("splat.near_plane: 0.2 -> 0.3"));
}
