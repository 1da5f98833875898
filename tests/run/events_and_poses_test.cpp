// SPDX-License-Identifier: Apache-2.0
// L_ev's windows and learned exposure poses, in whole runs and alone.
#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/dataset.h"
#include "jade/events/counts.h"
#include "jade/run/checkpoint.h"
#include "jade/run/trainer.h"
#include "jade/train/event_windows.h"
#include "jade/train/exposure_poses.h"
#include "run/tiny_scene.h"

using namespace jade;

namespace {

struct ShortScene : test::TinyScene {
  train::RunOptions options() const {
    train::RunOptions options;
    options.device = "cpu";
    options.dataset.path = data;
    options.objective.target = "edi";
    options.objective.warmup = 2;
    options.init.points = 200;
    options.densify.strategy = "none";
    options.train.iterations = options.train.calendar = 8;
    options.train.log_every = 1;
    options.train.evaluate_every = options.train.picture_every = 0;
    options.checkpoint.every = 4;
    return options;
  }
  data::Dataset dataset() const { return data::load_dataset(options().dataset); }
};

double largest(const torch::Tensor& t) { return t.abs().max().item<double>(); }

torch::Tensor poses_of(const data::Exposure& exposure) {
  std::vector<torch::Tensor> all;
  for (const auto& pose : exposure.poses) all.push_back(geometry::to_tensor(pose));
  return torch::stack(all);
}

}  // namespace

TEST_CASE("event windows: lie in the exposure, repeat with the seed, and count its events",
          "[run]") {
  const ShortScene scene;
  const data::Dataset dataset = scene.dataset();
  losses::ObjectiveOptions options;
  options.event_pixels = 50;
  const train::EventWindows windows(dataset, options, 7, torch::kCPU),
      same(dataset, options, 7, torch::kCPU);
  const int64_t height = dataset.train[1].camera.height, width = dataset.train[1].camera.width;
  bool moved = false;
  for (int64_t step = 1; step <= 20; ++step) {
    const train::EventWindow window = windows.at(step, 1), again = same.at(step, 1);
    CHECK(window.counts.equal(again.counts));
    CHECK(window.pixels.equal(again.pixels));
    CHECK(window.counts.sizes() == torch::IntArrayRef({height, width}));
    CHECK(window.pixels.numel() == 50);
    CHECK(std::get<0>(at::_unique(window.pixels)).numel() == 50);
    CHECK(window.pixels.max().item<int64_t>() < height * width);
    const torch::Tensor& cameras = window.cameras.camera_from_world;
    moved = moved || largest(cameras[0] - cameras[1]) > 1e-6;
    const events::ImageSize size{height, width};
    const double all = events::event_density(dataset.train[1].events, size).sum().item<double>();
    CHECK(window.counts.abs().sum().item<double>() <= all);
  }
  CHECK(moved);
  CHECK_FALSE(windows.at(1, 1).pixels.equal(windows.at(2, 1).pixels));
}

TEST_CASE("event windows: a window of the whole exposure counts all its events", "[run]") {
  const ShortScene scene;
  const data::Dataset dataset = scene.dataset();
  losses::ObjectiveOptions options;
  options.event_window_share = 1;
  const train::EventWindows windows(dataset, options, 7, torch::kCPU);
  const train::EventWindow window = windows.at(1, 0);
  const data::Exposure& exposure = dataset.train[0];
  CHECK(window.counts.equal(
      events::signed_count(exposure.events, {exposure.camera.height, exposure.camera.width})));
  CHECK(largest(window.cameras.camera_from_world[0] - poses_of(exposure)[0].to(torch::kFloat32)) <
        1e-6);
  CHECK(largest(window.cameras.camera_from_world[1] - poses_of(exposure)[8].to(torch::kFloat32)) <
        1e-6);
}

TEST_CASE("trainer: L_ev is a term of the objective where its weight is positive", "[run]") {
  const ShortScene scene;
  train::RunOptions options = scene.options();
  run::Trainer without(options, scene.dir.path() / "without", "");
  options.objective.event_loss_weight = 0.1;
  for (const char* const window : {"exposure", "recording"}) {
    options.objective.event_window = window;
    run::Trainer with(options, scene.dir.path() / window, "");
    for (int i = 0; i < 4; ++i) with.step();
    CHECK_THAT(read_file(scene.dir.path() / window / "metrics.jsonl"),
               Catch::Contains("\"event\":"));
    while (without.state().step < 4) without.step();
    CHECK_FALSE(without.state().gaussians.parameters().means.equal(
        with.state().gaussians.parameters().means));
  }
  CHECK_THAT(read_file(scene.dir.path() / "without" / "metrics.jsonl"),
             !Catch::Contains("\"event\":"));
}

TEST_CASE("exposure poses: start on the line between the exposure's ends, both kinds", "[run]") {
  const ShortScene scene;
  const data::Dataset dataset = scene.dataset();
  const train::ExposurePoses linear("linear", dataset.train), cubic("cubic", dataset.train);
  const torch::Tensor of_linear = linear.forward(1, torch::kCPU);
  const torch::Tensor given = poses_of(dataset.train[1]).to(torch::kFloat32);
  CHECK(largest(of_linear[0] - given[0]) < 1e-5);
  CHECK(largest(of_linear[8] - given[8]) < 1e-5);
  CHECK(largest(of_linear - cubic.forward(1, torch::kCPU)) < 1e-5);
}

TEST_CASE("exposure poses: training moves them, and a resumed run goes on to the bit", "[run]") {
  const ShortScene scene;
  for (const char* const kind : {"linear", "cubic"}) {
    train::RunOptions options = scene.options();
    options.objective.target = "none";
    options.objective.edi_supervision = options.objective.simulation = false;
    options.poses.optimize = kind;
    options.poses.accumulate = 3;
    const auto whole = scene.dir.path() / (std::string(kind) + "-whole");
    const auto halves = scene.dir.path() / (std::string(kind) + "-halves");
    run::Trainer trainer(options, whole, "");
    const torch::Tensor before = trainer.state().poses->forward(0, torch::kCPU).detach();
    trainer.run();
    const torch::Tensor after = trainer.state().poses->forward(0, torch::kCPU).detach();
    CHECK(largest(after - before) > 1e-6);
    train::RunOptions half = options;
    half.train.iterations = 4;
    run::Trainer(half, halves, "").run();
    run::Trainer second(options, halves, "latest");
    second.run();
    CHECK(second.state()
              .poses->forward(0, torch::kCPU)
              .equal(trainer.state().poses->forward(0, torch::kCPU)));
    CHECK(read_file(whole / "point_cloud.ply") == read_file(halves / "point_cloud.ply"));
  }
}

TEST_CASE("validate: learned poses and L_ev are refused together", "[run]") {
  train::RunOptions options;
  options.poses.optimize = "linear";
  options.objective.event_loss_weight = 0.1;
  CHECK_THROWS_AS(train::validate(options), ConfigError);
}
