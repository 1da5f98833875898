// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step_feed.h"

#include "support/catch.h"

#include <torch/types.h>

#include "train/bench.h"

using namespace jade;

namespace {

train::StepFeed feed_of(const test::TinyScene& scene, const train::RunOptions& options) {
  return {data::load_dataset(test::tiny_options(scene).dataset), options, torch::kCPU};
}

}  // namespace

TEST_CASE("step feed: a step is given its view, whatever was asked for before", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  options.exposure.quadrature = geometry::QuadratureRule::kJittered;
  options.objective.event_loss_weight = 0.1;
  options.objective.edi_weight_final = 0;
  options.train.iterations = options.train.calendar = 100;
  train::settle(options);
  train::StepFeed feed = feed_of(scene, options), late = feed_of(scene, options);
  std::vector<train::StepInputs> all;
  for (int64_t step = 1; step <= 40; ++step) all.push_back(feed.at(step));
  const train::StepInputs& early = all.front();
  const train::StepInputs last = late.at(40);
  CHECK(last.view_index == all.back().view_index);
  CHECK(last.view.u.equal(all.back().view.u));
  CHECK(last.view.cameras.camera_from_world.equal(all.back().view.cameras.camera_from_world));
  CHECK(last.pose_draws.equal(all.back().pose_draws));
  CHECK(last.events.counts.equal(all.back().events.counts));
  CHECK(last.term_weights[1].item<float>() == Approx(0.6f));
  CHECK(last.step == 40);
  CHECK_FALSE(last.view.u.equal(early.view.u));
  for (const train::StepInputs& in : all) {
    CHECK(in.view_pick.item<int64_t>() == in.view_index);
    CHECK(in.view.name == feed.views()[static_cast<size_t>(in.view_index)].name);
  }
}

TEST_CASE("step feed: what the options do not ask for is not there", "[train]") {
  const test::TinyScene scene;
  train::StepFeed feed = feed_of(scene, test::tiny_options(scene));
  const train::StepInputs in = feed.at(1);
  CHECK_FALSE(in.events.defined());
  CHECK_FALSE(in.term_weights.defined());
  CHECK(in.view.u.equal(feed.views()[static_cast<size_t>(in.view_index)].u));
}
