// SPDX-License-Identifier: Apache-2.0
#include "jade/run/checkpoint.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/data/dataset.h"
#include "support/tiny_run.h"

using namespace jade;

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
