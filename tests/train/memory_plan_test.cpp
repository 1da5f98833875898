// SPDX-License-Identifier: Apache-2.0
#include "jade/train/memory_plan.h"

#include "support/catch.h"

#include <limits>

#include "jade/core/error.h"

namespace jade::train {
namespace {

constexpr int64_t kUnlimited = std::numeric_limits<int64_t>::max();
constexpr int64_t kGib = int64_t{1} << 30;

data::Dataset frames_of(int width, int height) {
  data::Dataset dataset;
  dataset.train.resize(1);
  dataset.train[0].camera.width = width;
  dataset.train[0].camera.height = height;
  return dataset;
}

TEST_CASE("max_gaussians: auto grows with the side of the frames", "[train]") {
  CHECK(max_gaussians({}, frames_of(240, 180), kUnlimited) == 150000);
  CHECK(max_gaussians({}, frames_of(1280, 720), kUnlimited) == 480000);
  RunOptions options;
  options.densify.max_gaussians = 7;
  CHECK(max_gaussians(options, frames_of(1280, 720), kUnlimited) == 7);
}

TEST_CASE("max_gaussians: no more than a step's memory holds, unless they are given", "[train]") {
  const data::Dataset dataset = frames_of(1280, 720);
  RunOptions options;
  for (const int64_t budget : {2 * kGib, kGib + kGib / 2}) {
    const int64_t most = max_gaussians(options, dataset, budget);
    CHECK(most < 480000);
    CHECK(memory_plan(options, dataset, most).step() <= budget);
    CHECK(memory_plan(options, dataset, most + 1).step() > budget);
  }
  options.densify.max_gaussians = 2000000;
  CHECK(max_gaussians(options, dataset, 2 * kGib) == 2000000);
  options.exposure.samples = 33;
  CHECK_THROWS_WITH(max_gaussians(options, dataset, kGib / 2),
                    Catch::Contains("exposure.samples") && Catch::Contains("10,000 Gaussians"));
}

TEST_CASE("memory plan: constants get what a step leaves, up to a limit", "[train]") {
  const data::Dataset dataset = frames_of(346, 260);
  const MemoryPlan plan = memory_plan({}, dataset, 150000);
  // The measured peak without constants: 493 MiB (docs/results/cost/memory_parts.csv).
  CHECK(double(plan.step()) == Approx(double(int64_t{493} << 20)).epsilon(0.06));
  CHECK(constants_budget(plan, plan.step() + 1000) == 1000);
  CHECK(constants_budget(plan, plan.step() - 1) == 0);
  CHECK(constants_budget(plan, kUnlimited) == kMostConstantBytes);
  RunOptions routed = printed_options();
  routed.exposure.samples = RunOptions{}.exposure.samples;
  CHECK(memory_plan(routed, dataset, 150000).step() > plan.step());
}

}  // namespace
}  // namespace jade::train
