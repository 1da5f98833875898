// SPDX-License-Identifier: Apache-2.0
#include "jade/train/memory_plan.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "support/tiny_run.h"

namespace jade::train {
namespace {

TEST_CASE("memory plan: constants as the bank holds them, and Gaussians as many as there may be",
          "[train]") {
  const test::TinyScene scene;
  RunOptions options = test::all_poses_options(scene);
  options.objective.target = losses::Target::kEfnet;
  options.objective.edi_contrast = 1.3;
  options.densify.max_gaussians = 1000;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const ViewBank bank(dataset, options, torch::kCPU);
  const TrainState state = make_state(options, dataset, torch::kCPU);
  const int64_t count = bank.size();
  const int64_t pixels = dataset.train[0].camera.height * dataset.train[0].camera.width;
  const MemoryPlan plan = memory_plan(bank, state, options);
  CHECK(plan.constants.frames == count * pixels * 3 * 4 * 3);  // with both window means
  CHECK(plan.constants.edi == count * pixels * 9 * 2);         // float16, for one contrast
  CHECK(plan.gaussians == 1000 * 59 * 4 * 4);
  CHECK(plan.renders == 2 * 9 * 3 * pixels * 4);
  CHECK_THAT(text_of(plan, count, most_gaussians(state, options)),
             Catch::Contains(jade::concat(count, " frames")) && Catch::Contains("1,000 Gaussians"));
  options.densify.strategy = gaussians::DensifyStrategy::kNone;
  CHECK(memory_plan(bank, state, options).gaussians == state.gaussians.size() * 59 * 4 * 4);
}

}  // namespace
}  // namespace jade::train
