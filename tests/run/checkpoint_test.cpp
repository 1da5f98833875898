// SPDX-License-Identifier: Apache-2.0
#include "jade/run/checkpoint.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/data/dataset.h"
#include "jade/run/evaluate.h"
#include "jade/run/run_summary.h"
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
    return router::make_allocation({router::AllocationKind::kPerViewMap, 0.5}, views, 28, 36,
                                   make_generator(1, "maps"));
  };
  train::RunOptions options = test::tiny_options(scene);
  options.objective.target = losses::Target::kRouted;
  options.allocation.kind = router::AllocationKind::kPerViewMap;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  run::save_checkpoint(scene.dir / "run", train::make_state(options, dataset, torch::kCPU),
                       {"config", "data", ""}, 1);
  const auto load = [&](int64_t views) {
    run::load_checkpoint_allocation(run::checkpoint_path(scene.dir / "run", 0), *maps(views));
  };
  CHECK_NOTHROW(load(3));
  CHECK_THROWS_AS(load(4), CheckpointError);
  CHECK_THROWS_WITH(load(2), Catch::Contains("expected 2 parameters of 'allocation', found 3"));
}
