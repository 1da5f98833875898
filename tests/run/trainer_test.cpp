// SPDX-License-Identifier: Apache-2.0
#include "jade/run/trainer.h"

#include "support/catch.h"

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/random.h"
#include "jade/data/cameras.h"
#include "jade/data/dataset.h"
#include "jade/run/checkpoint.h"
#include "run/checkpoint_entries.h"
#include "support/naming.h"
#include "support/tensors.h"
#include "support/tiny_run.h"

using namespace jade;
using test::copies;
using test::equal;
using test::routed_options;
using test::tiny_options;
using Scene = test::TinyScene;

TEST_CASE("trainer: a view without events trains", "[run]") {
  test::TinyDatasetOptions data;
  data.last_exposure_without_events = true;
  const Scene scene(data);
  train::RunOptions options = tiny_options(scene);
  run::Trainer trainer(options, scene.dir.path() / "run", "");
  const int64_t last = trainer.bank().size() - 1;
  CHECK(trainer.bank().density(last).sum().item<double>() == 0);
  const train::View view = trainer.bank().picture_view(last);
  CHECK(view.restorations.edi.allclose(view.blurry()));
  for (int i = 0; i < 6; ++i) trainer.step(), trainer.densify();
  CHECK(trainer.state().gaussians.parameters().means.isfinite().all().item<bool>());
}

TEST_CASE("trainer: no opacity reset falls into the last tenth of a run", "[run]") {
  const Scene scene;
  train::RunOptions options = tiny_options(scene);
  options.densify.until = 1000;
  options.densify.opacity_reset_every = 10;
  options.train.evaluate_every = 0;
  run::Trainer trainer(options, scene.dir.path() / "run", "");
  const auto most_opaque = [&] {
    return trainer.state().gaussians.parameters().logit_opacities.sigmoid().max().item<double>();
  };
  for (int i = 0; i < 10; ++i) trainer.step(), trainer.densify();
  CHECK(most_opaque() < 0.011);
  for (int i = 0; i < 10; ++i) trainer.step(), trainer.densify();
  CHECK(most_opaque() > 0.012);
}

TEST_CASE("trainer: an evaluation at the step of an opacity reset sees the scene before it",
          "[run]") {
  const Scene scene;
  train::RunOptions options = tiny_options(scene);
  options.densify.until = 1000;
  options.densify.opacity_reset_every = 10;
  options.train.evaluate_every = 10;
  options.train.log_every = 10;
  const auto lines_at_10 = [&](const std::string& name) {
    run::Trainer(options, scene.dir / name, "").run();
    std::istringstream lines(read_file(scene.dir / name / "metrics.jsonl"));
    std::vector<nlohmann::json> found;
    for (std::string text; std::getline(lines, text);) {
      const auto line = nlohmann::json::parse(text);
      if (line.at("step") == 10) found.push_back(line);
    }
    REQUIRE(found.size() == 2);
    return found;
  };
  const auto reset = lines_at_10("reset");
  options.densify.opacity_reset_every = 0;
  const auto kept = lines_at_10("kept");
  CHECK(reset[0].at("psnr_train") == kept[0].at("psnr_train"));
  CHECK(reset[1].at("test_psnr") == kept[1].at("test_psnr"));
}

TEST_CASE("trainer: L_ev is a term of the objective where its weight is positive", "[run]") {
  const Scene scene;
  train::RunOptions options = tiny_options(scene);
  options.train.log_every = 1;
  run::Trainer without(options, scene.dir.path() / "without", "");
  options.objective.event_loss_weight = 0.1;
  run::Trainer with(options, scene.dir / "with", "");
  for (int i = 0; i < 4; ++i) {
    with.step();
    without.step();
  }
  CHECK_THAT(read_file(scene.dir / "with" / "metrics.jsonl"), Catch::Contains("\"event\":"));
  CHECK_FALSE(without.state().gaussians.parameters().means.equal(
      with.state().gaussians.parameters().means));
  CHECK_THAT(read_file(scene.dir.path() / "without" / "metrics.jsonl"),
             !Catch::Contains("\"event\":"));
}

TEST_CASE("trainer: two runs in one folder are refused while the first is alive", "[run]") {
  const test::TempDir dir;
  auto first = std::make_unique<run::RunDirectory>(dir.path() / "run");
  CHECK_THROWS_NAMING(DataError, run::RunDirectory(dir.path() / "run"), "run", "process");
  first.reset();
  CHECK_NOTHROW(run::RunDirectory(dir.path() / "run"));
}

TEST_CASE("trainer: an interrupt saves the finished step", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  set_interrupt_requested(true);
  const auto interrupted = [&] {
    train::RunOptions options = tiny_options(scene);
    options.train.iterations = 1000;
    // The interrupt is raised after the first step, because view preparation would stop too.
    set_interrupt_requested(false);
    run::Trainer trainer(options, run, "");
    set_interrupt_requested(true);
    trainer.run();
  };
  CHECK_THROWS_AS(interrupted(), Interrupted);
  set_interrupt_requested(false);
  CHECK(run::list_checkpoints(run) == std::vector{run::checkpoint_path(run, 1)});
}

TEST_CASE("trainer: pictures that cannot be written end the run, on the way and at its end",
          "[run]") {
  const Scene scene;
  train::RunOptions options = tiny_options(scene);
  options.train.evaluate_every = 0;
  for (const int64_t every : {4, 0}) {
    options.train.picture_every = every;
    const auto run = scene.dir.path() / concat("run", every);
    std::filesystem::create_directories(run);
    std::ofstream(run / "images") << "in the way";
    CHECK_THROWS_WITH(run::Trainer(options, run, "").run(), Catch::Contains("images"));
    CHECK(std::filesystem::exists(run / "report.html") == (every == 0));
    // The handler logs the reason.
    log_error("the reason");
    CHECK_THAT(read_file(run / "train.log"), Catch::Contains("the reason"));
    set_log_file({});
  }
}

TEST_CASE("trainer: what the data set warns of stands in the log", "[run]") {
  test::TinyDatasetOptions data;
  data.exposures = 1;
  const Scene scene(data);
  train::RunOptions options = tiny_options(scene);
  options.train.iterations = 1;
  const auto run = scene.dir.path() / "run";
  run::Trainer(options, run, "").run();
  CHECK_THAT(read_file(run / "train.log"), Catch::Contains("a single training frame"));
  log_warn("later");
  CHECK_THAT(read_file(run / "train.log"), !Catch::Contains("later"));
}

TEST_CASE("trainer: a run leaves the documented files", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  run::Trainer(tiny_options(scene), run, "").run();
  for (const char* name :
       {"config.yaml", "env.json", "train.log", "metrics.jsonl", "point_cloud.ply", "cameras.json",
        "eval.json", "report.html", "images/test_03.png", "images/truth_03.png"}) {
    INFO(name);
    CHECK(std::filesystem::exists(run / name));
  }
  // Poses that are not learned are those of the data.
  const auto cameras = data::read_cameras(run / "cameras.json");
  const data::Dataset dataset = data::load_dataset(tiny_options(scene).dataset, nullptr);
  REQUIRE(cameras.size() == dataset.test.size() + 9 * dataset.train.size());
  CHECK(cameras[0].camera_from_world.translation == dataset.test[0].pose.translation);
  CHECK(cameras.back().camera_from_world.translation ==
        dataset.train.back().poses.back().translation);
  std::ifstream metrics(run / "metrics.jsonl");
  int lines = 0;
  for (std::string line; std::getline(metrics, line); ++lines) {
    const auto object = nlohmann::json::parse(line);
    for (const char* key :
         {"step", "loss", "blur", "psnr_train", "gaussians", "seconds", "memory_bytes"}) {
      INFO(key);
      CHECK(object.contains(key));
    }
  }
  CHECK(lines == 4);
  // Both test views are taken after the last exposure.
  const auto scores = nlohmann::json::parse(read_file(run / "eval.json"));
  for (const auto& view : scores["views"]) CHECK(view["seen"] == false);
  CHECK(scores["mean_unseen"] == scores["mean"]);
  CHECK(scores["mean_seen"].is_null());
  CHECK_THAT(read_file(run / "report.html"),
             Catch::Contains(R"("name":"test view 04","camera":"test.1","seen":false)"));
}
