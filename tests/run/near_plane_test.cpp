// SPDX-License-Identifier: Apache-2.0
// A run's training, scores and pictures use one near plane, and so does resuming it.
#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/dataset.h"
#include "jade/imaging/image_io.h"
#include "jade/run/checkpoint.h"
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

std::string without_line(std::string text, const std::string& key) {
  const size_t at = text.find("  " + key + ":");
  REQUIRE(at != std::string::npos);
  return text.erase(at, text.find('\n', at) + 1 - at);
}

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

TEST_CASE("near plane: a run of a version without the key goes on as it was", "[run]") {
  ShortRun scene;
  {
    scene.options.splat.near_plane = 0.01;
    run::Trainer old(scene.options, scene.run, "");
    while (old.state().step < 3) old.step(), old.densify();
    const std::string config = without_line(read_file(scene.run / "config.yaml"), "near_plane");
    const std::string data = run::data_fingerprint(data::load_dataset(scene.options.dataset));
    run::save_checkpoint(scene.run, old.state(), {config, data, ""}, 1);
  }
  scene.options.splat.near_plane = 0;
  run::Trainer(scene.options, scene.run, "latest");
  const train::RunOptions now = run::load_run_options(scene.run);
  CHECK(now.splat.near_plane == 0);
  CHECK(train::render_options(now).near_plane == 0.01);
}
