// SPDX-License-Identifier: Apache-2.0
// Runs that stop and resume: bit-identical results, or rejected.
#include "support/catch.h"

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/random.h"
#include "jade/data/dataset.h"
#include "jade/imaging/image_io.h"
#include "jade/run/checkpoint.h"
#include "jade/run/evaluate.h"
#include "jade/run/learned_cameras.h"
#include "jade/run/trainer.h"
#include "jade/train/exposure_gains.h"
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

TEST_CASE("trainer: twenty steps equal ten, a resume, and ten more, to the bit", "[run]") {
  const Scene scene;
  const auto whole = scene.dir.path() / "whole", halves = scene.dir.path() / "halves";
  train::RunOptions options = tiny_options(scene);
  run::Trainer(options, whole, "").run();
  train::RunOptions half = options;
  half.train.iterations = 10;
  run::Trainer(half, halves, "").run();
  run::Trainer(options, halves, "latest").run();
  CHECK(read_file(run::checkpoint_path(whole, 20)).size() > 0);
  const auto a = run::load_checkpoint_scene(run::checkpoint_path(whole, 20)).gaussians;
  const auto b = run::load_checkpoint_scene(run::checkpoint_path(halves, 20)).gaussians;
  CHECK(equal(copies(a), copies(b)));
  CHECK(a.size() != 300);  // densification took part
  CHECK(read_file(whole / "point_cloud.ply") == read_file(halves / "point_cloud.ply"));
}

TEST_CASE(
    "trainer: with every pose restored a resume goes on to the same bits, and to others than "
    "with the middle",
    "[run]") {
  const Scene scene;
  const auto whole = scene.dir.path() / "whole", halves = scene.dir.path() / "halves";
  train::RunOptions options = test::all_poses_options(scene);
  options.train.iterations = options.train.calendar = 10;
  options.checkpoint.every = 5;
  run::Trainer(options, whole, "").run();
  train::RunOptions half = options;
  half.train.iterations = 5;
  run::Trainer(half, halves, "").run();
  run::Trainer(options, halves, "latest").run();
  const std::string all = read_file(whole / "point_cloud.ply");
  CHECK(all == read_file(halves / "point_cloud.ply"));
  options.objective.restored_poses = losses::RestoredPoses::kMiddle;
  CHECK_THROWS_WITH(run::Trainer(options, halves, "latest"),
                    Catch::Contains("objective.restored_poses: nine -> middle"));
  run::Trainer(options, scene.dir.path() / "middle", "").run();
  CHECK(all != read_file(scene.dir.path() / "middle" / "point_cloud.ply"));
}

TEST_CASE("trainer: target images are compared by content on resume, not by their folder",
          "[run]") {
  const Scene scene;
  const auto images = [&](const char* folder, double value) {
    for (const char* name : {"00.png", "01.png", "02.png"}) {
      imaging::write_image(scene.dir / folder / name, torch::full({3, 28, 36}, value));
    }
    return scene.dir / folder;
  };
  train::RunOptions options = tiny_options(scene);
  options.objective.target = losses::Target::kImageFolder;
  options.train.target_images = images("targets", 0.5);
  options.train.iterations = options.train.calendar = 2;
  run::Trainer(options, scene.dir / "run", "").run();
  options.train.target_images = images("moved", 0.5);
  CHECK_NOTHROW(run::Trainer(options, scene.dir / "run", "latest"));
  options.train.target_images = images("other", 0.25);
  CHECK_THROWS_NAMING(CheckpointError, run::Trainer(options, scene.dir / "run", "latest"),
                      "other data", "train.target_images");
}

TEST_CASE("trainer: a resumed run keeps the calendar it began with, whatever its new budget",
          "[run]") {
  const Scene scene;
  const auto whole = scene.dir.path() / "whole", halves = scene.dir.path() / "halves";
  train::RunOptions options = tiny_options(scene);
  options.objective.warmup = Steps::share(20);
  options.densify.until = Steps::share(80);
  options.train.calendar = 10;
  run::Trainer(options, whole, "").run();
  options.train.calendar = 0;
  options.train.iterations = 10;
  run::Trainer(options, halves, "").run();
  options.train.iterations = 20;
  {
    const run::Trainer trainer(options, halves, "latest");
    CHECK(trainer.options().train.calendar == 10);
    CHECK(trainer.options().objective.warmup == 2);
  }
  run::Trainer(options, halves, "latest").run();
  CHECK(read_file(whole / "point_cloud.ply") == read_file(halves / "point_cloud.ply"));
  // 2 of 10 steps and 20 % of 10 are the same schedule; 3 steps are another.
  options.objective.warmup = 2;
  CHECK_NOTHROW(run::Trainer(options, halves, "latest"));
  options.objective.warmup = 3;
  CHECK_THROWS_WITH(run::Trainer(options, halves, "latest"),
                    Catch::Contains("objective.warmup: 20% -> 3"));
}

TEST_CASE("trainer: whatever a checkpoint holds, a run that goes on from it does so to the bit",
          "[run]") {
  struct Case {
    std::string name;
    std::function<void(train::RunOptions&)> change;
    /// Entries that must differ between the two checkpoints.
    std::vector<std::string> moved;
  };
  const auto allocate = [](router::AllocationKind kind) {
    return [kind](train::RunOptions& o) { o.allocation.kind = kind; };
  };
  const std::vector<Case> cases{
      {"router",
       allocate(router::AllocationKind::kRouter),
       {"state.allocation.module.router.", "state.allocation.adam.", "state.gaussians.",
        "state.gaussian_adam.", "state.response.module.layer", "state.response.adam."}},
      {"per_view_map",
       allocate(router::AllocationKind::kPerViewMap),
       {"state.allocation.module.logits_0", "state.allocation.module.logits_1",
        "state.allocation.module.logits_2", "state.allocation.adam."}},
      {"poses",
       [](train::RunOptions& o) {
         o.poses.optimize = train::PosePath::kCubic;
         o.poses.test_fit_steps = 0;
       },
       {"state.poses.module.twists", "state.poses.adam.first", "state.poses.adam.second",
        "state.poses.adam.steps"}},
      {"poses_from_data",
       [](train::RunOptions& o) {
         o.poses.optimize = train::PosePath::kCubic;
         o.poses.start = train::PoseStart::kData;
         o.poses.test_fit_steps = 0;
         o.objective.event_loss_weight = 0.1;
       },
       {"state.poses.module.twists", "state.poses.adam.first", "state.poses.adam.second",
        "state.poses.adam.steps"}},
      {"gains",
       [](train::RunOptions& o) { o.gains.optimize = train::LearnGains::kOn; },
       {"state.gains.module.log_gains", "state.gains.adam.first", "state.gains.adam.second",
        "state.gains.adam.steps"}},
      {"pattern",
       [](train::RunOptions& o) { o.pattern.learn = train::LearnPattern::kOn; },
       {"state.pattern.module.offsets", "state.pattern.adam."}},
      {"mcmc",
       [](train::RunOptions& o) { o.densify.strategy = gaussians::DensifyStrategy::kMcmc; },
       {"generator"}},
      {"L_ev",
       [](train::RunOptions& o) { o.objective.event_loss_weight = 0.1; },
       {"state.gaussians."}}};
  const Scene scene;
  for (const Case& each : cases) {
    INFO(each.name);
    train::RunOptions options = routed_options(scene);
    each.change(options);
    const auto whole = scene.dir / (each.name + "-whole"), resumed = scene.dir / each.name;
    run::Trainer(options, whole, "").run();
    const auto middle = run::checkpoint_path(whole, 10), end = run::checkpoint_path(whole, 20);
    run::Trainer(options, resumed, middle.string()).run();
    CHECK(test::differing_entries(run::checkpoint_path(resumed, 20), end) ==
          std::set<std::string>());
    const bool logs_gains =
        read_file(whole / "metrics.jsonl").find("\"gain_max\":") != std::string::npos;
    CHECK(logs_gains == (each.name == "gains"));
    const auto moved = test::differing_entries(middle, end);
    for (const std::string& prefix : each.moved) {
      INFO(prefix);
      CHECK(test::any_begins_with(moved, prefix));
    }
  }
}

TEST_CASE("exposure poses: training moves them, and a resumed run goes on to the bit", "[run]") {
  const Scene scene;
  for (const train::PosePath path : {train::PosePath::kLinear, train::PosePath::kCubic}) {
    train::RunOptions options = tiny_options(scene);
    options.densify.strategy = gaussians::DensifyStrategy::kNone;
    options.train.iterations = options.train.calendar = 8;
    options.checkpoint.every = 4;
    options.objective.target = losses::Target::kNone;
    options.objective.edi_supervision = options.objective.simulation = false;
    options.poses.optimize = path;
    const auto whole = scene.dir / concat(word_of(path), "-whole");
    const auto halves = scene.dir / concat(word_of(path), "-halves");
    run::Trainer trainer(options, whole, "");
    const data::Dataset dataset = data::load_dataset(options.dataset);
    const auto path_of = [&](const run::Trainer& of) {
      return run::learned_path(*of.state().poses, 0, dataset.train[0]);
    };
    const torch::Tensor before = path_of(trainer);
    trainer.run();
    const torch::Tensor after = path_of(trainer);
    CHECK((after - before).abs().max().item<double>() > 1e-6);
    train::RunOptions half = options;
    half.train.iterations = 4;
    run::Trainer(half, halves, "").run();
    run::Trainer second(options, halves, "latest");
    second.run();
    CHECK(path_of(second).equal(after));
    CHECK(read_file(whole / "point_cloud.ply") == read_file(halves / "point_cloud.ply"));
  }
}

TEST_CASE("trainer: a corrupt newest checkpoint falls back to the one before", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  train::RunOptions options = tiny_options(scene);
  run::Trainer(options, run, "").run();
  const auto newest = run::checkpoint_path(run, 20);
  std::string bytes = read_file(newest);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  std::ofstream(newest, std::ios::binary) << bytes;
  CHECK_THROWS_AS(run::load_checkpoint_scene(newest), CheckpointError);
  {
    run::Trainer trainer(options, run, "latest");
    CHECK(trainer.state().step == 10);
  }
  for (const size_t size : {size_t{0}, size_t{100}, bytes.size() - 30}) {
    std::ofstream(newest, std::ios::binary) << bytes.substr(0, size);
    CHECK_THROWS_AS(run::load_checkpoint_scene(newest), CheckpointError);
  }
}

TEST_CASE("trainer: a scene whose checkpoints are gone is not started over", "[run]") {
  const Scene scene;
  const auto folder = scene.dir.path() / "run";
  train::RunOptions options = tiny_options(scene);
  options.train.iterations = 2;
  run::Trainer(options, folder, "").run();
  std::filesystem::remove_all(folder / "checkpoints");
  const std::string before = read_file(folder / "point_cloud.ply");
  CHECK_THROWS_NAMING(ConfigError, run::Trainer(options, folder, "latest"), "checkpoint", "scene");
  CHECK(read_file(folder / "point_cloud.ply") == before);
  std::filesystem::remove(folder / "point_cloud.ply");
  std::filesystem::remove(folder / "eval.json");
  CHECK_NOTHROW(run::Trainer(options, folder, "latest"));
}

TEST_CASE("trainer: fewer steps than a run has already are refused, and so is no checkpoint",
          "[run]") {
  const Scene scene;
  const auto folder = scene.dir.path() / "run";
  train::RunOptions options = tiny_options(scene);
  options.train.iterations = 4;
  run::Trainer(options, folder, "").run();
  const std::string before = read_file(folder / "point_cloud.ply");
  options.train.iterations = 2;
  CHECK_THROWS_NAMING(ConfigError, run::Trainer(options, folder, "latest"), "train.iterations",
                      "4");
  CHECK(read_file(folder / "point_cloud.ply") == before);
  CHECK_THROWS_NAMING(CheckpointError,
                      run::Trainer(options, folder, (folder / "checkpoints/none.pt").string()),
                      "none.pt");
}

TEST_CASE("trainer: refuses to resume with other settings or data, and says which", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  train::RunOptions options = tiny_options(scene);
  options.train.iterations = 3;
  run::Trainer(options, run, "").run();
  CHECK_THROWS_NAMING(DataError, run::Trainer(options, run, ""), "--resume");
  options.train.iterations = 5;
  CHECK_NOTHROW(run::Trainer(options, run, "latest"));
  options.objective.dssim = 0.2;
  CHECK_THROWS_WITH(run::Trainer(options, run, "latest"),
                    Catch::Contains("objective.dssim: 0.3 -> 0.2"));
  options.objective.dssim = 0.3;
  test::TinyDatasetOptions other;
  other.last_exposure_without_events = true;
  std::filesystem::remove_all(scene.data);
  test::write_tiny_dataset(scene.data, other);
  CHECK_THROWS_NAMING(CheckpointError, run::Trainer(options, run, "latest"), "dataset.path",
                      "held_out.txt");
}

TEST_CASE("trainer: a checkpoint that cannot be written ends the run", "[run]") {
  const Scene scene;
  const auto run = scene.dir / "run";
  run::Trainer trainer(tiny_options(scene), run, "");
  write_file(run / "checkpoints", "a file where the folder should be");
  CHECK_THROWS_NAMING(DataError, trainer.run(), "checkpoints");
  for (const char* end : {"point_cloud.ply", "eval.json"}) {
    CHECK_FALSE(std::filesystem::exists(run / end));
  }
}

TEST_CASE("trainer: a folder is no checkpoint to resume from", "[run]") {
  const Scene scene;
  const auto resume = [&] {
    run::Trainer(tiny_options(scene), scene.dir / "run", scene.dir.path().string());
  };
  CHECK_THROWS_AS(resume(), ConfigError);
  CHECK_THROWS_NAMING(ConfigError, resume(), "--resume", "folder");
}

TEST_CASE("trainer: refuses to resume with another restorer, wherever its file lies", "[run]") {
  const Scene scene;
  const auto run = scene.dir / "run";
  train::RunOptions options = routed_options(scene);
  options.train.iterations = 3;
  run::Trainer(options, run, "").run();
  const std::string expected = file_sha256(options.efnet.path);
  CHECK_THAT(read_file(run / "env.json"), Catch::Contains(expected));
  options.efnet.path = scene.dir / "moved.pt";
  std::filesystem::rename(scene.dir / "restorer.pt", options.efnet.path);
  CHECK_NOTHROW(run::Trainer(options, run, "latest"));
  const auto other = test::save_restorer(options.efnet.path, "  return 0.8 * image\n");
  const auto resume = [&] { run::Trainer(options, run, "latest"); };
  CHECK_THROWS_AS(resume(), CheckpointError);
  CHECK_THROWS_WITH(resume(), Catch::Contains(expected) && Catch::Contains(file_sha256(other)) &&
                                  Catch::Contains("efnet.path"));
  // A run without a restored target does not read a restorer.
  train::RunOptions plain = tiny_options(scene);
  plain.train.iterations = 3;
  run::Trainer(plain, scene.dir / "plain", "").run();
  CHECK_THAT(read_file(scene.dir / "plain" / "env.json"), !Catch::Contains("restorer_sha256"));
  plain.efnet.path = scene.dir / "nowhere.pt";
  CHECK_NOTHROW(run::Trainer(plain, scene.dir / "plain", "latest"));
}

TEST_CASE("trainer: a run that goes on from an older checkpoint leaves the later ones", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  train::RunOptions options = tiny_options(scene);
  options.train.iterations = options.train.calendar = 12;
  options.checkpoint.every = 4;
  options.checkpoint.keep = 3;
  run::Trainer(options, run, "").run();
  REQUIRE(run::list_checkpoints(run).size() == 3);
  const std::string end = read_file(run / "point_cloud.ply");
  options.checkpoint.keep = 1;
  {
    run::Trainer going(options, run, run::checkpoint_path(run, 4).string());
    set_interrupt_requested(true);
    CHECK_THROWS_AS(going.run(), Interrupted);
    set_interrupt_requested(false);
  }
  CHECK(run::list_checkpoints(run) ==
        std::vector<std::filesystem::path>{run::checkpoint_path(run, 5)});
  CHECK(std::filesystem::exists(run / "checkpoints/left_step_0000012.pt"));
  CHECK(run::newest_scene(run).gaussians.size() > 0);  // of the checkpoint, as the old end is gone
  CHECK_FALSE(std::filesystem::exists(run / "point_cloud.ply"));
  CHECK(read_file(run / "left_point_cloud.ply") == end);
  run::Trainer(options, run, "latest").run();
  CHECK(read_file(run / "point_cloud.ply") == end);
  CHECK_FALSE(std::filesystem::exists(run / "left_point_cloud.ply"));
  CHECK_FALSE(std::filesystem::exists(run / "left_report.html"));
}

TEST_CASE("trainer: a run writes whether it learns gains, and keeps it when the data set changes",
          "[run]") {
  const Scene scene;
  write_file(scene.data / "gains.csv", "name,gain\n00,1\n01,0.8\n02,1.1\n03,1\n");
  train::RunOptions options = tiny_options(scene);
  options.gains.optimize = train::LearnGains::kAuto;
  options.train.iterations = 2;
  const std::filesystem::path folder = scene.dir / "run";
  run::Trainer(options, folder, "").run();
  const train::RunOptions saved = run::load_run_options(folder);
  CHECK(saved.gains.optimize == train::LearnGains::kOn);
  CHECK_NOTHROW(run::Trainer(options, folder, "latest"));
  CHECK(run::load_run_options(folder).gains.optimize == train::LearnGains::kOn);
  std::filesystem::remove(scene.data / "gains.csv");
  CHECK(train::learns_gains(saved.gains, data::load_dataset(options.dataset)));
}

TEST_CASE("trainer: a run goes on without the file that it started from", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  train::RunOptions options = tiny_options(scene);
  options.train.iterations = options.train.calendar = 4;
  options.init.kind = gaussians::InitKind::kPly;
  options.init.ply = scene.dir.path() / "start.ply";
  run::Trainer(tiny_options(scene), scene.dir.path() / "other", "").run();
  std::filesystem::copy_file(scene.dir.path() / "other/point_cloud.ply", options.init.ply);
  run::Trainer(options, run, "").run();
  std::filesystem::remove(options.init.ply);
  options.train.iterations = 6;
  run::Trainer(options, run, "latest").run();
  CHECK(std::filesystem::exists(run::checkpoint_path(run, 6)));
}
