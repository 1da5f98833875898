// SPDX-License-Identifier: Apache-2.0
#include "jade/run/restored_pictures.h"

#include "support/catch.h"

#include <algorithm>
#include <chrono>
#include <thread>
#include <torch/types.h>

#include "jade/data/dataset.h"
#include "jade/restore/restorations.h"
#include "jade/run/evaluate.h"
#include "jade/run/trainer.h"
#include "jade/serve/render_queue.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

namespace fs = std::filesystem;

/// A finished run, and its data.
struct EndedRun {
  const test::TinyScene scene;
  train::RunOptions options;
  run::Trainer trainer;
  data::Dataset dataset;

  explicit EndedRun(train::RunOptions (*make)(const test::TinyScene&))
      : options(make(scene)),
        trainer(options, scene.dir / "run", ""),
        dataset(data::load_dataset(options.dataset)) {
    trainer.run();
  }
  fs::path folder() const { return scene.dir / "run"; }
  size_t cached() const {
    return static_cast<size_t>(
        std::distance(fs::directory_iterator(scene.dir / "cache"), fs::directory_iterator()));
  }
};

std::vector<std::string> names(const std::vector<run::ViewPicture>& pictures) {
  std::vector<std::string> all;
  for (const run::ViewPicture& each : pictures) all.push_back(each.name);
  return all;
}

/// Polls like a viewer.
torch::Tensor made(const std::vector<run::ViewPicture>& pictures, const std::string& name) {
  const auto picture = std::find_if(pictures.begin(), pictures.end(),
                                    [&](const auto& each) { return each.name == name; });
  REQUIRE(picture != pictures.end());
  for (int i = 0; i < 600; ++i) {
    try {
      return picture->make();
    } catch (const serve::NotYet&) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  FAIL(name << " did not come");
  return {};
}

}  // namespace

TEST_CASE("restored pictures: a run's layers are those that it was trained with, from the cache",
          "[run]") {
  const bool all_poses = GENERATE(false, true);
  const EndedRun ended(all_poses ? test::all_poses_options : test::routed_options);
  const size_t cached = ended.cached();
  run::RestoredPictures pictures(ended.folder(), ended.options, ended.dataset, torch::kCPU);
  const auto layers = pictures.of(1);
  CHECK(names(layers) == std::vector<std::string>{"EDI", "EFNet", "α", "fused", "event density"});
  const train::View view = ended.trainer.bank().picture_view(1);
  CHECK(made(layers, "EDI").equal(view.restorations.edi));
  CHECK(made(layers, "EFNet").equal(view.restorations.efnet));
  const torch::NoGradGuard no_grad;
  const torch::Tensor alpha = ended.trainer.state().allocation->forward(view.measured, 1);
  CHECK(made(layers, "α").allclose(alpha.expand({1, 28, 36})));
  CHECK(made(layers, "fused").allclose(restore::fuse(alpha, view.restorations)));
  const torch::Tensor density = ended.trainer.bank().density(1);
  CHECK(made(layers, "event density")[0].allclose(density / density.max()));
  CHECK(ended.cached() == cached);
}

TEST_CASE(
    "restored pictures: what the cache has lost is restored in the background, the middle only",
    "[run]") {
  const EndedRun ended(test::all_poses_options);
  const torch::Tensor middle = ended.trainer.bank().picture_view(2).restorations.efnet;
  fs::remove_all(ended.scene.dir / "cache");
  {
    run::RestoredPictures pictures(ended.folder(), ended.options, ended.dataset, torch::kCPU);
    CHECK(made(pictures.of(2), "EFNet").allclose(middle, 0, 3e-4));
  }
  REQUIRE(ended.cached() == 1);
  for (const auto& entry : fs::directory_iterator(ended.scene.dir / "cache")) {
    CHECK(entry.file_size() < 2 * 3 * 28 * 36 * sizeof(float));
  }
}

TEST_CASE("restored pictures: many that are asked for and not awaited hold nothing up", "[run]") {
  const EndedRun ended(test::routed_options);
  const torch::Tensor first = ended.trainer.bank().picture_view(0).restorations.efnet;
  fs::remove_all(ended.scene.dir / "cache");
  run::RestoredPictures pictures(ended.folder(), ended.options, ended.dataset, torch::kCPU);
  for (int64_t i = 0; i < 3; ++i) {
    try {
      pictures.of(i)[1].make();
    } catch (const serve::NotYet&) {
    }
  }
  CHECK(made(pictures.of(0), "EFNet").allclose(first, 0, 1e-5));
}

TEST_CASE("restored pictures: another restorer, or an allocation that is gone, leave a layer out",
          "[run]") {
  const EndedRun ended(test::routed_options);
  fs::remove_all(ended.folder() / "checkpoints");
  CHECK(names(run::RestoredPictures(ended.folder(), ended.options, ended.dataset, torch::kCPU)
                  .of(0)) == std::vector<std::string>{"EDI", "EFNet", "event density"});
  test::save_restorer(ended.options.efnet.path, "  return 0.5 * image\n");
  CHECK(names(run::RestoredPictures(ended.folder(), ended.options, ended.dataset, torch::kCPU)
                  .of(0)) == std::vector<std::string>{"EDI", "event density"});
}

TEST_CASE("restored pictures: a run without a restorer has EDI", "[run]") {
  const EndedRun ended(test::tiny_options);
  run::RestoredPictures pictures(ended.folder(), ended.options, ended.dataset, torch::kCPU);
  CHECK(names(pictures.of(0)) == std::vector<std::string>{"EDI", "event density"});
  CHECK(made(pictures.of(0), "EDI").equal(ended.trainer.bank().picture_view(0).restorations.edi));
}
