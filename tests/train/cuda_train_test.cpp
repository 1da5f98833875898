// SPDX-License-Identifier: Apache-2.0
// Whole runs on a GPU: recorded steps against eager ones, and resuming to the bit.
#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/train/trainer.h"
#include "train/tiny_scene.h"

using namespace jade;

namespace {

struct GpuScene : test::TinyScene {
  /// Everything but the routing step acts: target "edi" needs no restorer.
  train::RunOptions options() const {
    train::RunOptions options;
    options.device = "cuda";
    options.dataset.path = data;
    options.scene.target = "edi";
    options.scene.warmup = 6;
    options.scene.simulation_start = 12;
    options.scene.event_loss_weight = 0.1;
    options.init.points = 300;
    options.densify.from = 5;
    options.densify.every = 10;
    options.densify.gradient_threshold = 1e-5;
    options.densify.max_gaussians = 500;
    options.train.iterations = options.train.calendar = 30;
    options.train.sh_degree_every = 8;
    options.train.log_every = 5;
    options.train.evaluate_every = options.train.picture_every = 0;
    options.checkpoint.every = 10;
    return options;
  }
};

double mean_difference(const torch::Tensor& a, const torch::Tensor& b) {
  return ((a - b).abs().mean() / b.abs().mean()).item<double>();
}

}  // namespace

TEST_CASE("trainer: recorded steps agree with eager ones across warm-up and densification",
          "[train][cuda]") {
  const GpuScene scene;
  train::RunOptions options = scene.options();
  train::Trainer recorded(options, scene.dir.path() / "recorded", "");
  options.train.cuda_graph = false;
  train::Trainer eager(options, scene.dir.path() / "eager", "");
  for (int i = 0; i < 9; ++i) {
    recorded.step();
    eager.step();
  }
  CHECK(eager.replays() == 0);
  CHECK(recorded.replays() > 4);
  const auto& a = recorded.state().gaussians.parameters();
  const auto& b = eager.state().gaussians.parameters();
  REQUIRE(a.size() == b.size());
  CHECK(mean_difference(a.means, b.means) < 1e-4);
  CHECK(mean_difference(a.sh, b.sh) < 1e-2);
  for (int i = 0; i < 20; ++i) recorded.step();
  CHECK(recorded.replays() > 15);
  CHECK(recorded.state().gaussians.size() != 300);
  CHECK(recorded.state().gaussians.parameters().sh.isfinite().all().item<bool>());
}

TEST_CASE("trainer: a deterministic run on a GPU resumes to the bit", "[train][cuda]") {
  const GpuScene scene;
  train::RunOptions options = scene.options();
  options.deterministic = true;
  const auto whole = scene.dir.path() / "whole", halves = scene.dir.path() / "halves";
  train::Trainer(options, whole, "").run();
  train::RunOptions half = options;
  half.train.iterations = 20;
  train::Trainer(half, halves, "").run();
  train::Trainer(options, halves, "latest").run();
  CHECK(read_file(whole / "point_cloud.ply") == read_file(halves / "point_cloud.ply"));
}
