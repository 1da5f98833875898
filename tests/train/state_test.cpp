// SPDX-License-Identifier: Apache-2.0
#include "jade/train/state.h"

#include "support/catch.h"

#include <cmath>
#include <set>
#include <torch/types.h>

#include "jade/splat/math/sh.h"
#include "train/bench.h"

using namespace jade;

namespace {

/// The names of all visited tensors, without duplicates.
template <class Visited>
std::set<std::string> names_in(const Visited& visited) {
  std::set<std::string> names;
  visited.visit([&](const std::string& name, const torch::Tensor&) {
    INFO(name);
    CHECK(names.insert(name).second);
  });
  return names;
}

}  // namespace

TEST_CASE("visit: the inputs of a step name each tensor once, at its own place", "[train]") {
  const test::TinyScene scene;
  const test::Bench bench(scene);
  const train::StepInputs inputs = bench.inputs(0, 1);
  CHECK(names_in(inputs) == std::set<std::string>{"view.measured",
                                                  "view.mask",
                                                  "view.window_mean",
                                                  "view.window_square",
                                                  "view.reblur_kernel",
                                                  "view.u",
                                                  "view.weights",
                                                  "term_weights",
                                                  "view.restorations.edi",
                                                  "view.restorations.efnet",
                                                  "view.fixed_target",
                                                  "view.cameras.camera_from_world",
                                                  "view.cameras.intrinsics",
                                                  "pose_draws",
                                                  "edi_factors.gray",
                                                  "edi_factors.color",
                                                  "edi_factors.simulation",
                                                  "events.cameras.camera_from_world",
                                                  "events.cameras.intrinsics",
                                                  "events.u",
                                                  "events.counts",
                                                  "events.pixels",
                                                  "events.color_filter",
                                                  "view_pick"});
  std::set<const torch::Tensor*> places;
  inputs.visit([&](const std::string&, const torch::Tensor& tensor) { places.insert(&tensor); });
  CHECK(places.size() == names_in(inputs).size());
}

TEST_CASE("visit: what is written through a visit stays in the inputs that were visited",
          "[train]") {
  const test::TinyScene scene;
  const test::Bench bench(scene);
  const train::StepInputs inputs = bench.inputs(0, 1);
  train::StepInputs own = inputs;
  own.visit([](const std::string&, torch::Tensor& tensor) {
    if (tensor.defined()) tensor = tensor.clone().zero_();
  });
  CHECK(own.view.measured.abs().max().item<double>() == 0);
  CHECK(own.view.restorations.edi.abs().max().item<double>() == 0);
  CHECK(inputs.view.measured.max().item<double>() > 0);
}

TEST_CASE("visit: the state names all that a step writes", "[train]") {
  const test::TinyScene scene;
  test::Bench bench(scene);
  bench.options.poses.optimize = train::PosePath::kCubic;
  bench.options.poses.start = train::PoseStart::kData;
  bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
  std::set<std::string> changed;
  std::vector<torch::Tensor> before;
  bench.state.visit([&](const std::string&, const torch::Tensor& tensor) {
    before.push_back(tensor.detach().clone());
  });
  const auto names = names_in(bench.state);
  CHECK(names.size() == before.size());
  bench.step(bench.inputs(0, 10));
  bench.alternate(bench.inputs(0, 11));  // whose gradient is accumulated until the update
  size_t next = 0;
  bench.state.visit([&](const std::string& name, const torch::Tensor& tensor) {
    if (tensor.equal(before[next++])) return;
    changed.insert(name);
    changed.insert(name.substr(0, name.find_last_of('.')));
  });
  for (const char* part :
       {"gaussians", "gaussian_adam.first", "gaussian_adam.second", "gaussian_adam", "densifier",
        "allocation.adam.first", "response.adam.first", "poses.module.twists", "poses.adam.first",
        "poses.adam.second", "poses.adam.steps", "poses.adam.gradient", "poses.adam.seen"}) {
    INFO(part);
    CHECK(changed.count(part) == 1);
  }
}

TEST_CASE("state: the modules follow the options", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const train::TrainState plain = train::make_state(options, dataset, torch::kCPU);
  CHECK(plain.gaussians.size() == 300);
  CHECK(plain.gaussians.extent() > 0);
  CHECK_FALSE(plain.allocation);
  CHECK(plain.allocation.adam.empty());
  CHECK_FALSE(plain.response.adam.empty());
  CHECK_FALSE(plain.poses);
  options.objective.target = losses::Target::kRouted;
  options.response.lr = 0;
  options.poses.optimize = train::PosePath::kLinear;
  const train::TrainState other = train::make_state(options, dataset, torch::kCPU);
  CHECK_FALSE(other.allocation.adam.empty());
  CHECK(other.response.adam.empty());
  CHECK_FALSE(other.poses.adam.empty());
  options.response.enabled = false;
  CHECK_FALSE(train::make_state(options, dataset, torch::kCPU).response);
}

TEST_CASE("state: the densification threshold is that of nine renders, a K-th of each with K",
          "[train]") {
  train::RunOptions options = train::printed_options();
  CHECK(train::gradient_factor(options, 1) == 1);
  options.exposure.samples = 17;
  CHECK(train::gradient_factor(options, 1) == Approx(9.0 / 17));
  CHECK(train::gradient_factor(options, 4) == Approx(9.0 / 5));
  // L_tgt alone renders one pose.
  options.objective.blur = options.objective.simulation = options.objective.intensity = false;
  CHECK(train::gradient_factor(options, 4) == 1);
}

TEST_CASE("state: the first points leave out masked pixels and gains", "[train]") {
  data::Dataset dataset;
  dataset.near = 1, dataset.far = 4;
  for (int i = 0; i < 3; ++i) {
    data::Exposure exposure;
    exposure.camera = geometry::Intrinsics::centred(20, 16, 12);
    exposure.blurry = torch::full({3, 12, 16}, 0.6);
    exposure.blurry.slice(2, 0, 8).fill_(1);
    exposure.mask = torch::ones({1, 12, 16}, torch::kBool);
    exposure.mask.slice(2, 0, 8).fill_(false);
    exposure.gain = 2;
    dataset.train.push_back(std::move(exposure));
  }
  train::RunOptions options;
  options.init.kind = gaussians::InitKind::kRandomFrusta;
  options.init.points = 50;
  const train::TrainState state = train::make_state(options, dataset, torch::kCPU);
  const torch::Tensor base = state.gaussians.parameters().sh.select(1, 0);
  const double brightest = 0.5 + splat::math::kSh0 * base.max().item<double>();
  CHECK(brightest == Approx(0.3));
}

namespace {

/// The tiny scene with all lengths times `scale`, after some steps of MCMC with learned poses; its
/// values are divided by `scale` again.
struct InUnits {
  torch::Tensor means, log_scales, centres;

  InUnits(const test::TinyScene& scene, double scale) {
    test::Bench bench(scene);
    for (data::Exposure& exposure : bench.dataset.train) {
      for (geometry::Pose& pose : exposure.poses) {
        for (double& t : pose.translation) t *= scale;
      }
    }
    bench.dataset.near *= scale, bench.dataset.far *= scale;
    bench.options.poses = train::RunOptions().poses;
    bench.options.densify.strategy = gaussians::DensifyStrategy::kMcmc;
    bench.options.splat.near_plane = train::near_plane(bench.options.splat, bench.dataset);
    bench.prepare(torch::kCPU);
    bench.options.objective.target = losses::Target::kRouted;
    bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
    train::TrainState& state = bench.state;
    for (int64_t step = 1; step <= 9; ++step) {
      bench.step(bench.inputs(step % 3, step));
      state.densifier.update(step, state.gaussians, state.gaussian_adam);
    }
    const torch::NoGradGuard no_grad;
    means = state.gaussians.parameters().means / scale;
    log_scales = state.gaussians.parameters().log_scales - std::log(scale);
    const torch::Tensor path =
        train::exposure_cameras(state, bench.inputs(1, 10)).camera_from_world;
    centres = path.narrow(1, 0, 3).select(2, 3) / scale;
  }
};

}  // namespace

TEST_CASE("state: a scene in kilometres or millimetres trains like any other", "[train]") {
  const test::TinyScene scene;
  const InUnits small(scene, std::pow(2, -10)), large(scene, std::pow(2, 10));
  CHECK((small.means - large.means).abs().max().item<double>() < 0.01);
  CHECK((small.log_scales - large.log_scales).abs().max().item<double>() < 0.01);
  CHECK((small.centres - large.centres).abs().max().item<double>() < 2e-3);
}
