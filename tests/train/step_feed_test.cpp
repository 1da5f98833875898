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
  options.objective.event_loss_weight = 0.1;
  options.objective.edi_weight_final = 0;
  options.train.iterations = options.train.calendar = 100;
  train::settle(options);
  train::StepFeed feed = feed_of(scene, options), late = feed_of(scene, options);
  std::vector<train::StepInputs> all;
  for (int64_t step = 1; step <= 40; ++step) all.push_back(feed.at(step));
  const train::StepInputs last = late.at(40);
  CHECK(last.view_index == all.back().view_index);
  CHECK(last.view.cameras.camera_from_world.equal(all.back().view.cameras.camera_from_world));
  CHECK(last.pose_draws.equal(all.back().pose_draws));
  CHECK(last.events.counts.equal(all.back().events.counts));
  CHECK(last.term_weights[1].item<float>() == Approx(0.6f));
  CHECK(last.step == 40);
  for (const train::StepInputs& in : all) {
    CHECK(in.view_pick.item<int64_t>() == in.view_index);
    CHECK(in.view.measured.equal(feed.bank().picture_view(in.view_index).measured));
  }
}

TEST_CASE("step feed: where every pose is restored a step is given its drawn pose's view",
          "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  train::StepFeed feed = feed_of(scene, options), plain_feed = [&] {
    train::RunOptions middle = options;
    middle.objective.restored_poses = losses::RestoredPoses::kMiddle;
    return feed_of(scene, middle);
  }();
  bool other_than_middle = false;
  for (int64_t step = 1; step <= 12; ++step) {
    const train::StepInputs in = feed.at(step), plain = plain_feed.at(step);
    REQUIRE(in.pose_draws.numel() == 4);
    CHECK(plain.pose_draws.equal(in.pose_draws.narrow(0, 0, 3)));
    CHECK(plain.view_index == in.view_index);
    const int64_t pose = in.pose_draws[3].item<int64_t>();
    const train::View expected = feed.bank().step_view(in.view_index, pose);
    CHECK(in.view.restorations.efnet.equal(expected.restorations.efnet));
    CHECK(in.view.measured.equal(expected.measured));
    const train::View middle = feed.bank().picture_view(in.view_index);
    CHECK(torch::allclose(plain.view.restorations.efnet, middle.restorations.efnet, 0, 3e-4));
    if (pose != 4) CHECK_FALSE(in.view.restorations.efnet.equal(middle.restorations.efnet));
    other_than_middle |= pose != 4;
  }
  CHECK(other_than_middle);
  options.objective.target = losses::Target::kNone;
  CHECK(feed_of(scene, options).at(1).pose_draws.numel() == 3);
}

TEST_CASE("step feed: a step is given the EDI factors of its poses, and nothing that none reads",
          "[train]") {
  const test::TinyScene scene;
  train::RunOptions taught = test::tiny_options(scene);
  taught.objective.edi_contrast = 1.5;
  for (const train::RunOptions& options : {taught, test::routed_options(scene)}) {
    const bool routed = options.objective.target == losses::Target::kRouted;
    INFO("routed: " << routed);
    train::StepFeed feed = feed_of(scene, options);
    for (int64_t step = 1; step <= 5; ++step) {
      const train::StepInputs in = feed.at(step);
      const torch::Tensor all = feed.bank().edi_factors(in.view_index).to(torch::kFloat32);
      const auto at = [&](int64_t term) { return all[in.pose_draws[term].item<int64_t>()]; };
      CHECK(in.edi_factors.gray.equal(at(0)));
      CHECK(in.edi_factors.color.equal(at(1)));
      CHECK(in.edi_factors.simulation.equal(at(2)));
      CHECK(in.view.measured.size(0) == (routed ? 5 : 3));
      CHECK(in.view.reblur_kernel.defined() == routed);
      CHECK(in.view.restorations.edi.defined() == routed);
    }
  }
}

TEST_CASE("step feed: what the options do not ask for is not there", "[train]") {
  const test::TinyScene scene;
  train::StepFeed feed = feed_of(scene, test::tiny_options(scene));
  const train::StepInputs in = feed.at(1);
  CHECK_FALSE(in.events.defined());
  CHECK_FALSE(in.term_weights.defined());
  CHECK(in.view.u.equal(feed.bank().step_view(in.view_index).u));
}

TEST_CASE("step feed: early steps are given every fourth moment, then every second", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  options.exposure = {geometry::QuadratureRule::kTrapezoid, 9};
  options.objective.target = losses::Target::kEfnet;
  options.objective.edi_contrast = 1.5;
  options.train.quarter_moments_until = 4;
  options.train.half_moments_until = 12;
  train::StepFeed feed = feed_of(scene, options);
  for (const auto& [step, stride] : {std::pair<int64_t, int64_t>{3, 4}, {11, 2}, {13, 1}, {2, 4}}) {
    INFO("step " << step);
    const train::StepInputs in = feed.at(step);
    const train::View view = feed.bank().step_view(in.view_index);
    const int64_t moments = 8 / stride + 1;
    CHECK(in.view.u.equal(torch::linspace(0, 1, moments, torch::kFloat64)));
    CHECK(in.view.cameras.intrinsics.size(0) == moments);
    for (int64_t k = 0; k < moments; ++k) {
      CHECK(in.view.cameras.camera_from_world[k].equal(view.cameras.camera_from_world[k * stride]));
    }
    CHECK(in.view.weights.sum().item<double>() == Approx(1));
    CHECK(in.view.weights[0].item<double>() == Approx(0.5 / double(moments - 1)));
    CHECK(in.pose_draws.max().item<int64_t>() < moments);
    // Factors and target are those of the sampled moments.
    const auto drawn = [&](int64_t term) { return stride * in.pose_draws[term].item<int64_t>(); };
    const torch::Tensor factors = feed.bank().edi_factors(in.view_index);
    CHECK(in.edi_factors.simulation.equal(factors[drawn(2)].to(torch::kFloat32)));
    const train::View of_drawn = feed.bank().step_view(in.view_index, drawn(3));
    CHECK(in.view.fixed_target.equal(of_drawn.fixed_target));
  }
  CHECK(feed.bank().step_view(0).u.size(0) == 9);
}
