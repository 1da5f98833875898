// SPDX-License-Identifier: Apache-2.0
#include "jade/train/plan.h"

#include "support/catch.h"

using namespace jade;
using router::AllocationKind;

namespace {

train::RunOptions settled() {
  train::RunOptions options = train::printed_options();
  train::settle(options);
  return options;
}

}  // namespace

TEST_CASE("plan: the paper's run changes at the steps of its calendar and at no other", "[train]") {
  const train::RunOptions options = settled();
  std::vector<int64_t> changes;
  for (int64_t step = 2; step <= 25000; ++step) {
    if (train::plan_step(options, step) != train::plan_step(options, step - 1)) {
      changes.push_back(step);
    }
  }
  // SH degrees, warm-up, L_sim, and the last step with screen gradients.
  CHECK(changes == std::vector<int64_t>{1000, 1501, 2000, 3000, 7001, 15000});
  const train::StepPlan last = train::plan_step(options, 25000);
  CHECK(last.route);
  CHECK(last.sh_degree == 3);
  CHECK_FALSE(last.statistics);
  CHECK_FALSE(last.learned_poses);
  CHECK(last.recordable);
}

TEST_CASE("plan: the allocation is trained while a routed target acts", "[train]") {
  train::RunOptions options = settled();
  const auto plan = [&](AllocationKind kind) {
    options.allocation.kind = kind;
    return train::plan_step(options, 1);
  };
  for (const AllocationKind kind : {AllocationKind::kRouter, AllocationKind::kRouterNoSigmoid,
                                    AllocationKind::kGlobalScalar, AllocationKind::kPerViewMap}) {
    CHECK(plan(kind).objective.target);
    CHECK(plan(kind).route);
  }
  options.objective.target = losses::Target::kEdi;
  CHECK(plan(AllocationKind::kRouter).objective.target);
  CHECK_FALSE(plan(AllocationKind::kRouter).route);
  options.objective.target = losses::Target::kRouted;
  options.objective.target_until = 5;
  options.allocation.kind = AllocationKind::kRouter;
  CHECK(train::plan_step(options, 5).route);
  CHECK_FALSE(train::plan_step(options, 6).route);
}

TEST_CASE("plan: a step that depends on the host is not recorded", "[train]") {
  const auto recordable = [](const auto& change) {
    train::RunOptions options = settled();
    change(options);
    return train::plan_step(options, 1).recordable;
  };
  CHECK(recordable([](train::RunOptions&) {}));
  CHECK_FALSE(recordable([](train::RunOptions& o) { o.train.cuda_graph = false; }));
  CHECK_FALSE(recordable([](train::RunOptions& o) { o.deterministic = true; }));
  CHECK(recordable([](train::RunOptions& o) { o.poses.optimize = train::PosePath::kLinear; }));
  CHECK_FALSE(
      recordable([](train::RunOptions& o) { o.allocation.kind = AllocationKind::kPerViewMap; }));
}

TEST_CASE("plan: learned poses are those of every step, of one plan", "[train]") {
  train::RunOptions options = settled();
  options.poses.optimize = train::PosePath::kCubic;
  CHECK(train::plan_step(options, 4).learned_poses);
  CHECK(train::plan_step(options, 3) == train::plan_step(options, 4));
}

TEST_CASE("plan: screen gradients count for adc alone and end with it", "[train]") {
  train::RunOptions options = settled();
  CHECK(train::plan_step(options, 14999).statistics);
  CHECK_FALSE(train::plan_step(options, 15000).statistics);
  options.densify.strategy = gaussians::DensifyStrategy::kMcmc;
  CHECK_FALSE(train::plan_step(options, 1).statistics);
}

TEST_CASE("plan: an exposure has few moments early, as many as its number allows", "[train]") {
  train::RunOptions options;
  options.train.iterations = 1000;
  train::settle(options);
  const auto stride = [&](int64_t samples, int64_t step) {
    options.exposure.samples = samples;
    return train::plan_step(options, step).moment_stride;
  };
  CHECK(stride(17, 1) == 4);
  CHECK(stride(17, 125) == 4);
  CHECK(stride(17, 126) == 2);
  CHECK(stride(17, 200) == 2);
  CHECK(stride(17, 201) == 1);
  // Mid-exposure stays among them: of 13 moments, seven, and of 11 all.
  CHECK(stride(13, 1) == 2);
  CHECK(stride(11, 1) == 1);
  options.exposure.samples = 17;
  const double mean = train::mean_share_of_moments(options);
  CHECK(mean == Approx((0.125 * 5 + 0.075 * 9 + 0.8 * 17) / 17).epsilon(1e-9));
  options.train.quarter_moments_until = 0;
  CHECK(train::plan_step(options, 1).moment_stride == 2);
  options.train.half_moments_until = 0;
  CHECK(train::mean_share_of_moments(options) == 1);
}
