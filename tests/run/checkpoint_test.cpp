// SPDX-License-Identifier: Apache-2.0
#include "jade/run/checkpoint.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/data/dataset.h"
#include "jade/run/evaluate.h"
#include "jade/run/resume.h"
#include "jade/run/run_summary.h"
#include "support/naming.h"
#include "support/temp_dir.h"
#include "support/tiny_run.h"

using namespace jade;

TEST_CASE("checkpoint: stored settings did as printed where a later version has a key more",
          "[run]") {
  const std::string old = "train: {iterations: 100}\nobjective: {target: edi}\n";
  const test::TempDir dir;
  dir.write("config.yaml", old);
  for (const train::RunOptions& saved : {run::saved_options(old), run::load_run_options(dir.path()),
                                         run::summarize_run(dir.path()).options}) {
    CHECK(saved.train.iterations == 100);
    CHECK(saved.exposure.samples == 9);
    CHECK(saved.exposure.quadrature == geometry::QuadratureRule::kEqual);
    CHECK(saved.events.ramp_ms == 0);
    CHECK(saved.poses.optimize == train::PosePath::kNone);
    CHECK(saved.densify.strategy == gaussians::DensifyStrategy::kAdc);
  }
}

TEST_CASE("checkpoint: maps of another number of views are refused", "[run]") {
  const test::TinyScene scene;
  const auto maps = [](int64_t views) {
    return router::make_allocation({router::AllocationKind::kPerViewMap}, views, 28, 36,
                                   make_generator(1, "maps"));
  };
  train::RunOptions options = test::tiny_options(scene);
  options.objective.target = losses::Target::kRouted;
  options.allocation.kind = router::AllocationKind::kPerViewMap;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const train::TrainState state = train::make_state(options, dataset, torch::kCPU);
  run::write_checkpoint(scene.dir / "run", run::checkpoint_of(state, {"config", "data", ""}), 1);
  const auto load = [&](int64_t views) {
    run::load_checkpoint_allocation(run::checkpoint_path(scene.dir / "run", 0), *maps(views));
  };
  CHECK_NOTHROW(load(3));
  CHECK_THROWS_AS(load(4), CheckpointError);
  CHECK_THROWS_NAMING(CheckpointError, load(2), "2 tensors", "allocation", "3");
}

TEST_CASE("checkpoint: the data's fingerprint knows frames, times, poses, cameras and events",
          "[run]") {
  const test::TinyScene scene;
  const data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  const std::string fingerprint = run::data_fingerprint(dataset);
  CHECK(run::data_fingerprint(dataset) == fingerprint);
  const auto changed = [&](const auto& change) {
    data::Dataset other = dataset;
    change(other.train.at(1));
    return run::data_fingerprint(other) != fingerprint;
  };
  CHECK_FALSE(changed([](data::Exposure&) {}));
  CHECK(changed([](data::Exposure& e) { e.blurry = e.blurry + 1e-3; }));
  CHECK(changed([](data::Exposure& e) { e.t_end_us += 1; }));
  CHECK(changed([](data::Exposure& e) { e.name += "_"; }));
  CHECK(changed([](data::Exposure& e) { e.poses[7].translation[1] += 1e-6; }));
  CHECK(changed([](data::Exposure& e) { e.poses[0].rotation[3] += 1e-6; }));
  CHECK(changed([](data::Exposure& e) { e.events = events::EventStream(); }));
  CHECK(changed([](data::Exposure& e) { e.camera.cy += 1e-6; }));
  CHECK(changed([](data::Exposure& e) {
    const events::EventStream& old = e.events;
    e.events = events::EventStream(old.x(), old.y(), old.t_us(), -old.polarity());
  }));
  CHECK(changed([](data::Exposure& e) {
    const events::EventStream& old = e.events;
    e.events = events::EventStream(old.x() + 1, old.y(), old.t_us(), old.polarity());
  }));
  data::Dataset gray = dataset;
  gray.monochrome = true;
  CHECK(run::data_fingerprint(gray) != fingerprint);
}

TEST_CASE("checkpoint: a copy of the state, which may change while it is written", "[run]") {
  const test::TinyScene scene;
  const train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const train::TrainState state = train::make_state(options, dataset, torch::kCPU);
  const torch::Tensor means = state.gaussians.parameters().means.detach();
  const torch::Tensor before = means.clone();
  const run::Checkpoint checkpoint = run::checkpoint_of(state, {"config", "data", ""});
  means.add_(1);
  run::write_checkpoint(scene.dir / "run", checkpoint, 1);
  const auto path = run::checkpoint_path(scene.dir / "run", 0);
  CHECK(run::load_checkpoint_scene(path).gaussians.means.equal(before));
}

TEST_CASE("checkpoint: another format is refused by its version", "[run]") {
  const test::TinyScene scene;
  const train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  run::Checkpoint checkpoint =
      run::checkpoint_of(train::make_state(options, dataset, torch::kCPU), {"config", "data", ""});
  checkpoint.at("format_version").fill_(1);
  run::write_checkpoint(scene.dir / "run", checkpoint, 1);
  const auto path = run::checkpoint_path(scene.dir / "run", 0);
  CHECK_THROWS_NAMING(CheckpointError, run::read_checkpoint_info(path), path.filename().string(),
                      "format 2", "found 1");
}
