// SPDX-License-Identifier: Apache-2.0
#include "jade/train/exposure_poses.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/data/dataset.h"
#include "jade/train/view.h"
#include "support/poses.h"
#include "train/bench.h"

using namespace jade;
using train::PosePath;
using train::PoseStart;

namespace {

train::PoseOptions learned(PosePath path, PoseStart start) {
  train::PoseOptions options = train::printed_options().poses;
  options.optimize = path;
  options.start = start;
  return options;
}

torch::Tensor pick(int64_t exposure) { return torch::tensor({exposure}, torch::kInt64); }

torch::Tensor nine_poses(const train::ExposurePoses& poses, const data::Dataset& dataset,
                         int64_t exposure) {
  const data::Exposure& given = dataset.train[static_cast<size_t>(exposure)];
  return poses.forward(
      pick(exposure), train::pose_times(torch::kCPU),
      train::camera_batch({given.poses.begin(), given.poses.end()}, given.camera, torch::kCPU)
          .camera_from_world);
}

/// Error of the learned poses relative to `truth` in the image of a point of the tiny scene, px:
/// root mean square over exposures and poses, minus the common part.
double relative_error_px(const train::ExposurePoses& poses, const data::Dataset& given,
                         const data::Dataset& truth) {
  std::vector<torch::Tensor> errors;
  const torch::Tensor point = torch::tensor({0.05f, 0.02f, 2.0f, 1.0f});
  const auto image = [&](const torch::Tensor& camera_from_world) {
    const torch::Tensor p = camera_from_world.to(torch::kFloat32).matmul(point);
    return truth.train[0].camera.fx * p.narrow(0, 0, 2) / p[2];
  };
  for (size_t i = 0; i < truth.train.size(); ++i) {
    const torch::Tensor path = nine_poses(poses, given, static_cast<int64_t>(i)).detach();
    for (size_t k = 0; k < 9; ++k) {
      errors.push_back(image(path[static_cast<int64_t>(k)]) -
                       image(test::pose_of(truth.train[i], k)));
    }
  }
  const torch::Tensor all = torch::stack(errors);
  return (all - all.mean(0)).square().sum(1).mean().sqrt().item<double>();
}

/// A bench with learned poses and a fixed scene.
struct PoseBench : test::Bench {
  explicit PoseBench(const test::TinyScene& scene, const train::PoseOptions& poses) : Bench(scene) {
    options.poses = poses;
    options.densify.strategy = gaussians::DensifyStrategy::kNone;
    state = train::make_state(options, dataset, torch::kCPU);
  }
  torch::Tensor twists() const { return state.poses->twists().detach().clone(); }
};

}  // namespace

TEST_CASE("pose_lr: falls log-linearly over its steps, and stays", "[train]") {
  train::PoseOptions options;
  options.lr = 1e-2, options.lr_max_steps = 100;
  for (const auto& [step, rate] : {std::pair{0, 1e-2}, {50, 1e-3}, {100, 1e-4}, {500, 1e-4}}) {
    CHECK(train::pose_lr(options, step) == Approx(rate));
  }
  options.lr = 0;
  CHECK(train::pose_lr(options, 1) == 0);
}

TEST_CASE("exposure poses: start on the line between the exposure's ends, both kinds", "[train]") {
  const test::TinyScene scene;
  const data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  const train::ExposurePoses linear(learned(PosePath::kLinear, PoseStart::kLine), dataset),
      cubic(learned(PosePath::kCubic, PoseStart::kLine), dataset);
  const torch::Tensor of_linear = nine_poses(linear, dataset, 1);
  CHECK(test::largest(of_linear[0] - test::pose_of(dataset.train[1], 0)) < 1e-5);
  CHECK(test::largest(of_linear[8] - test::pose_of(dataset.train[1], 8)) < 1e-5);
  CHECK(test::largest(of_linear - nine_poses(cubic, dataset, 1)) < 1e-5);
}

TEST_CASE("exposure poses: a correction starts at the data's poses to the bit, at any times",
          "[train]") {
  const test::TinyScene scene;
  const test::Bench bench(scene);
  for (const PosePath path : {PosePath::kLinear, PosePath::kCubic}) {
    const train::ExposurePoses poses(learned(path, PoseStart::kData), bench.dataset);
    for (int64_t view = 0; view < 3; ++view) {
      const torch::Tensor& data = bench.views[static_cast<size_t>(view)].cameras.camera_from_world;
      CHECK(nine_poses(poses, bench.dataset, view).equal(data));
      const torch::Tensor two = data.index_select(0, torch::tensor({5, 2}, torch::kInt64));
      const torch::Tensor u = torch::tensor({0.625, 0.25}, torch::kFloat64);
      CHECK(poses.forward(pick(view), u, two).equal(two));
    }
  }
}

TEST_CASE("exposure poses: a run that starts at the data's poses renders as one without",
          "[train]") {
  const test::TinyScene scene;
  PoseBench with(scene, learned(PosePath::kCubic, PoseStart::kData)),
      without(scene, train::printed_options().poses);
  const auto same = [&](int64_t step) {
    const train::StepInputs in = with.inputs(1, step);
    return with.render(in).color.equal(without.render(in).color);
  };
  CHECK(same(9));
  for (PoseBench* bench : {&with, &without}) {
    bench->options.objective.blur = bench->options.objective.intensity = false;
    bench->options.objective.simulation = false;
  }
  CHECK(same(9));  // only three poses
}

TEST_CASE("exposure poses: the poses that a step reads are those of all nine", "[train]") {
  const test::TinyScene scene;
  for (const PoseStart start : {PoseStart::kLine, PoseStart::kData}) {
    PoseBench bench(scene, learned(PosePath::kCubic, start));
    {
      const torch::NoGradGuard no_grad;
      torch::manual_seed(2);
      bench.state.poses->twists().add_(0.01 * torch::randn({3, 4, 6}, torch::kFloat64));
    }
    const train::StepInputs in = bench.inputs(2, 1);
    const torch::Tensor read = torch::tensor({7, 0, 4}, torch::kInt64);
    const auto all = train::exposure_cameras(bench.state, in);
    const auto some = train::exposure_cameras(bench.state, in, read);
    CHECK(some.camera_from_world.equal(all.camera_from_world.index_select(0, read)));
    CHECK(some.camera_from_world.sizes() == torch::IntArrayRef({3, 4, 4}));
    CHECK(some.intrinsics.size(0) == 3);
    CHECK_FALSE(all.camera_from_world.equal(in.view.cameras.camera_from_world));
  }
}

TEST_CASE("exposure poses: frames of a model without times start with some motion", "[train]") {
  const test::TinyScene scene;
  data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  for (data::Exposure& exposure : dataset.train) exposure.poses.fill(exposure.poses[4]);
  const auto first_motion = [&](PosePath path, PoseStart start) {
    const torch::Tensor nine =
        nine_poses(train::ExposurePoses(learned(path, start), dataset), dataset, 1);
    return test::largest(nine[0] - nine[8]);
  };
  for (const PosePath path : {PosePath::kLinear, PosePath::kCubic}) {
    for (const PoseStart start : {PoseStart::kLine, PoseStart::kData}) {
      dataset.events = data::load_dataset(test::tiny_options(scene).dataset).events;
      CHECK(first_motion(path, start) < 1e-6);
      dataset.events = {};
      CHECK(first_motion(path, start) > 1e-5);
      CHECK(first_motion(path, start) < 2e-2);
      CHECK(first_motion(path, start) == first_motion(path, start));
    }
  }
}

TEST_CASE("exposure poses: one that a step did not see keeps still to the bit", "[train]") {
  const test::TinyScene scene;
  PoseBench bench(scene, learned(PosePath::kCubic, PoseStart::kLine));
  bench.step(bench.inputs(0, 1));
  bench.step(bench.inputs(1, 2));
  const torch::Tensor before = bench.twists();
  CHECK(before[0].abs().max().item<double>() > 0);
  for (int64_t step = 3; step <= 5; ++step) bench.step(bench.inputs(1, step));
  CHECK(bench.twists()[0].equal(before[0]));
  CHECK_FALSE(bench.twists()[1].equal(before[1]));
  CHECK(bench.twists()[2].abs().max().item<double>() == 0);
}

TEST_CASE("exposure poses: of a correction, one that a step did not see moves with the world alone",
          "[train]") {
  const test::TinyScene scene;
  PoseBench bench(scene, learned(PosePath::kCubic, PoseStart::kData));
  bench.step(bench.inputs(0, 1));
  bench.step(bench.inputs(1, 2));
  const train::RowAdamState& adam = bench.state.poses.adam.state();
  const torch::Tensor first = adam.first[0].clone();
  const torch::Tensor before = bench.twists();
  bench.step(bench.inputs(1, 3));
  CHECK(adam.first[0].equal(first));
  CHECK(adam.steps.equal(torch::tensor({1.0, 2.0, 0.0}, torch::kFloat64)));
  // The camera of this scene only translates, so one translation, rotation and scaling of the world
  // describes the motion of exposures 0 and 2 completely.
  const torch::Tensor change = bench.twists() - before;
  CHECK(change[0].abs().max().item<double>() > 0);
  torch::Tensor turns = change.narrow(-1, 3, 3);
  CHECK(test::largest(turns[0] - turns[2]) < 1e-12);
  CHECK(test::largest(turns[0][0] - turns[0][3]) < 1e-12);
}

TEST_CASE("exposure poses: a drift of all cameras stays zero while relative motion is learned",
          "[train]") {
  const test::TinyScene scene;
  const data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  train::ExposurePoses poses(learned(PosePath::kLinear, PoseStart::kData), dataset);
  const auto set = [&](const torch::Tensor& values) {
    const torch::NoGradGuard no_grad;
    poses.twists().copy_(values);
    poses.hold_gauge();
    return poses.twists().detach().clone();
  };
  torch::Tensor turns = torch::zeros({3, 2, 6}, torch::kFloat64);
  turns[0][0][4] = 0.4, turns[1][1][4] = -0.4;
  const torch::Tensor apart = set(turns);
  CHECK(test::largest(apart) > 0.2);
  // All cameras have one orientation, so a translation of the world translates all of them equally.
  const torch::Tensor drift = torch::tensor({0.3, -0.2, 0.1, 0.0, 0.0, 0.0}, torch::kFloat64);
  CHECK(test::largest(set(drift.expand({3, 2, 6}))) < 1e-12);
  train::RowAdam adam(poses.twists());
  for (int64_t step = 0; step < 900; ++step) {
    const int64_t view = step % 3;
    poses.twists().mutable_grad() = torch::Tensor();
    (poses.twists()[view] - (apart + drift)[view]).square().sum().backward();
    adam.accumulate(pick(view));
    adam.update(0.01 * std::pow(0.995, static_cast<double>(step)));
    poses.hold_gauge();
    CHECK(test::largest(poses.twists().detach().narrow(-1, 0, 3).flatten(0, 1).mean(0)) < 1e-12);
  }
  CHECK(test::largest(poses.twists().detach() - apart) < 0.02);
}

TEST_CASE("exposure poses: L_ev moves them through its own two cameras", "[train]") {
  const test::TinyScene scene;
  for (const PoseStart start : {PoseStart::kLine, PoseStart::kData}) {
    PoseBench bench(scene, learned(PosePath::kLinear, start));
    bench.options.objective.event_loss_weight = 0.1;
    const train::EventWindows windows(bench.dataset, bench.options.objective, 1, torch::kCPU);
    train::StepInputs in = bench.inputs(1, 10);
    in.events = windows.at(10, 1);
    const auto gradient = [&](double weight) {
      bench.state = train::make_state(bench.options, bench.dataset, torch::kCPU);
      bench.options.objective.event_loss_weight = weight;
      bench.alternate(in);
      return bench.state.poses.adam.state().gradient.clone();
    };
    const torch::Tensor without = gradient(0), with = gradient(0.1);
    CHECK(test::largest(with[1] - without[1]) > 1e-9);
    CHECK(test::largest(with[0]) == 0);
  }
}

TEST_CASE("exposure poses: wrong poses get right against a scene that is, from either start",
          "[train][slow]") {
  const test::TinyScene scene;
  test::Bench bench(scene);
  bench.options.objective.target = losses::Target::kNone;
  bench.options.objective.edi_supervision = bench.options.objective.simulation = false;
  bench.options.objective.warmup = 100;
  bench.options.densify.strategy = gaussians::DensifyStrategy::kNone;
  gaussians::OptimOptions& optim = bench.options.optim;
  for (double* lr : {&optim.position_lr_start, &optim.sh_dc_lr, &optim.sh_rest_lr,
                     &optim.opacity_lr, &optim.scale_lr, &optim.rotation_lr}) {
    *lr = 1e-20;
  }
  const splat::Gaussians right = bench.state.gaussians.detached();
  data::Dataset wrong = bench.dataset;
  for (size_t i = 0; i < 3; ++i) {
    train::View& view = bench.views[i];
    const torch::NoGradGuard no_grad;
    const splat::RenderOptions render = train::render_options(bench.options);
    test::set_frame(view, splat::render(right, view.cameras, render).color.mean(0));
    data::Exposure& exposure = wrong.train[i];
    const double shift = (1.0 - static_cast<double>(i)) * 2 / exposure.camera.fx;  // -1, 0, 1 px
    for (geometry::Pose& pose : exposure.poses) {
      pose.translation[0] += shift;
      pose.translation[1] -= shift;
    }
    view.cameras = train::camera_batch({exposure.poses.begin(), exposure.poses.end()},
                                       exposure.camera, torch::kCPU);
  }
  for (const PoseStart start : {PoseStart::kLine, PoseStart::kData}) {
    INFO(word_of(start));
    bench.options.poses = learned(PosePath::kLinear, start);
    bench.options.poses.lr = 0.02;
    bench.options.poses.lr_max_steps = 60;  // a tenth of it after the 30 steps
    bench.state = train::make_state(bench.options, wrong, torch::kCPU);
    bench.state.gaussians = gaussians::GaussianModel(right, 1, torch::kCPU);
    bench.state.gaussian_adam = gaussians::GaussianAdam(bench.state.gaussians, optim, false);
    const auto error = [&] { return relative_error_px(*bench.state.poses, wrong, bench.dataset); };
    const double before = error();
    CHECK(before > 1);
    for (int64_t step = 1; step <= 30; ++step) bench.step(bench.inputs(step % 3, step));
    INFO(before << " -> " << error() << " px");
    CHECK(error() < 0.5 * before);
  }
}
