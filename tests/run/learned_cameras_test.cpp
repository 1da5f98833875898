// SPDX-License-Identifier: Apache-2.0
// Test views of scenes with learned exposure poses: aligned, fitted, stored and read back.
#include "jade/run/learned_cameras.h"

#include "support/catch.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/random.h"
#include "jade/data/cameras.h"
#include "jade/data/dataset.h"
#include "jade/eval/metrics.h"
#include "jade/gaussians/init.h"
#include "jade/gaussians/ply.h"
#include "jade/geometry/alignment.h"
#include "jade/geometry/se3.h"
#include "jade/imaging/image_io.h"
#include "jade/run/checkpoint.h"
#include "jade/run/evaluate.h"
#include "jade/run/trainer.h"
#include "support/naming.h"
#include "support/se3_log.h"
#include "support/tiny_run.h"

using namespace jade;
using train::PosePath;

namespace {

/// A short run with learned poses, and its folder.
struct LearnedRun : test::TinyScene {
  train::RunOptions options;
  std::filesystem::path run = dir.path() / "run";

  LearnedRun() {
    options = test::tiny_options(*this);
    options.train.calendar = 0;
    options.objective.target = losses::Target::kNone;
    options.objective.edi_supervision = options.objective.simulation = false;
    options.objective.warmup = 2;
    options.densify.strategy = gaussians::DensifyStrategy::kNone;
    options.poses.optimize = PosePath::kLinear;
    options.poses.test_fit_steps = 20;
  }
  /// Options of learned poses, which a run with fixed poses lacks.
  train::PoseOptions learned() const {
    train::PoseOptions poses = train::printed_options().poses;
    poses.optimize = PosePath::kLinear;
    return poses;
  }
};

geometry::Pose nudged(const geometry::Pose& pose, double rotation, double shift) {
  const auto twist = torch::tensor({shift, -shift, 0.0, rotation, 0.0, -rotation}, torch::kFloat64);
  return geometry::pose_from_tensor(geometry::to_tensor(pose).matmul(geometry::se3_exp(twist)));
}

geometry::Pose in_millimetres(geometry::Pose pose) {
  for (double& t : pose.translation) t *= 1000;
  return pose;
}

splat::Gaussians moved(splat::Gaussians g, torch::Device device) {
  for (torch::Tensor* each : {&g.means, &g.rotations, &g.log_scales, &g.logit_opacities, &g.sh}) {
    *each = each->to(device);
  }
  return g;
}

double error_px(const geometry::Pose& a, const geometry::Pose& b, const data::SharpView& view) {
  const geometry::Vector3 p = geometry::transform(a, {0.05, 0.02, 2}),
                          q = geometry::transform(b, {0.05, 0.02, 2});
  return view.camera.fx * std::hypot(p[0] / p[2] - q[0] / q[2], p[1] / p[2] - q[1] / q[2]);
}

}  // namespace

namespace {

/// @param device  to render on
void check_fit(torch::Device device) {
  LearnedRun scene;
  scene.options.poses.optimize = PosePath::kNone;
  scene.options.objective.target = losses::Target::kEdi;
  scene.options.train.iterations = 150;
  run::Trainer trainer(scene.options, scene.run, "");
  while (trainer.state().step < 150) trainer.step(), trainer.densify();
  const auto gaussians = moved(trainer.state().gaussians.detached(), device);

  data::Dataset dataset = data::load_dataset(scene.options.dataset);
  const train::ExposurePoses unmoved(scene.learned(), dataset);
  data::SharpView& view = dataset.test[0];
  const geometry::Pose truth = view.pose;
  view.image = run::render_view(gaussians, truth, view.camera, {});
  view.pose = nudged(truth, 0.01, 0.03);
  const auto psnr_from = [&](const geometry::Pose& pose) {
    return eval::psnr(run::render_view(gaussians, pose, view.camera, {}), view.image);
  };

  const data::Dataset aligned = run::with_learned_poses(dataset, unmoved, gaussians, {}, {});
  CHECK(error_px(aligned.test[0].pose, view.pose, view) < 1e-3);
  const data::Dataset fitted = run::with_learned_poses(dataset, unmoved, gaussians, {200}, {});
  CHECK(psnr_from(fitted.test[0].pose) > psnr_from(view.pose) + 10);

  // In millimetres the fit is the same.
  data::Dataset in_mm = dataset;
  for (data::Exposure& exposure : in_mm.train) {
    for (geometry::Pose& pose : exposure.poses) pose = in_millimetres(pose);
  }
  for (data::SharpView& each : in_mm.test) each.pose = in_millimetres(each.pose);
  in_mm.near *= 1000, in_mm.far *= 1000;
  splat::Gaussians larger = gaussians;
  larger.means = gaussians.means * 1000;
  larger.log_scales = gaussians.log_scales + std::log(1000);
  const data::Dataset fitted_mm = run::with_learned_poses(
      in_mm, train::ExposurePoses(scene.learned(), in_mm), larger, {200}, {});
  const auto fitted_picture = run::render_view(larger, fitted_mm.test[0].pose, view.camera, {});
  CHECK(eval::psnr(fitted_picture, view.image) > psnr_from(view.pose) + 10);

  // An interrupt ends the fit early, except in an evaluation that would not be repeated.
  set_interrupt_requested(true);
  const data::Dataset ended = run::with_learned_poses(dataset, unmoved, gaussians, {200}, {});
  const data::Dataset finished = run::with_learned_poses(
      dataset, unmoved, gaussians, {200, false, run::OnInterrupt::kFinish}, {});
  set_interrupt_requested(false);
  CHECK(error_px(ended.test[0].pose, view.pose, view) < 1e-3);
  CHECK(error_px(finished.test[0].pose, fitted.test[0].pose, view) < 1e-3);

  // Views are fitted together, and none acts on another.
  data::Dataset more = dataset;
  more.test.push_back(view);
  more.test.back().pose = nudged(truth, -0.01, 0.02);
  more.test.push_back(view);
  more.test.back().image = view.image * 0.5;
  more.test.back().gain = 0.5;
  const data::Dataset together = run::with_learned_poses(more, unmoved, gaussians, {200}, {});
  CHECK(error_px(together.test[0].pose, fitted.test[0].pose, view) < 0.02);
  for (size_t i = more.test.size() - 2; i < more.test.size(); ++i) {
    CHECK(psnr_from(together.test[i].pose) > psnr_from(more.test[i].pose) + 10);
  }
  const data::Dataset brightened =
      run::with_learned_poses(more, unmoved, gaussians, {200, /*gain=*/true}, {});
  CHECK(psnr_from(brightened.test.back().pose) > psnr_from(view.pose) + 10);

  // The fit of a later scene continues from there: it needs no step if nothing changed.
  run::PoseFit warm;
  warm.from = &fitted;
  const data::Dataset again = run::with_learned_poses(dataset, unmoved, gaussians, warm, {});
  CHECK(error_px(again.test[0].pose, fitted.test[0].pose, view) < 1e-3);
}

}  // namespace

TEST_CASE("learned cameras: a test pose that is off by pixels is fitted to its image", "[run]") {
  check_fit(torch::kCPU);
}

TEST_CASE("learned cameras: the same on a GPU", "[run][cuda]") { check_fit(torch::kCUDA); }

TEST_CASE("learned cameras: test views follow a motion that all exposures share", "[run]") {
  const LearnedRun scene;
  const data::Dataset dataset = data::load_dataset(scene.options.dataset);
  const train::ExposurePoses poses(scene.learned(), dataset);
  const geometry::Similarity motion{
      1, geometry::rotation_from_vector({0.2, -0.4, 0.1}), {0.5, -0.3, 0.8}};
  const geometry::Pose there{motion.rotation, motion.translation};
  {
    // world_from_camera · exp(ξ) = motion · world_from_camera
    const torch::NoGradGuard no_grad;
    torch::Tensor twists = poses.parameters()[0];
    for (size_t i = 0; i < dataset.train.size(); ++i) {
      const auto& path = dataset.train[i].poses;
      for (int64_t end = 0; end < 2; ++end) {
        const auto camera = geometry::to_tensor(end == 0 ? path.front() : path.back());
        const auto world = geometry::to_tensor(there);
        twists[static_cast<int64_t>(i)][end].copy_(
            test::se3_log(camera.matmul(world).matmul(geometry::se3_inverse(camera))));
      }
    }
  }
  auto generator = make_generator(1, "points");
  gaussians::InitSources sources;
  sources.views.push_back(
      {dataset.train[0].poses[4], dataset.train[0].camera, dataset.train[0].blurry, {}});
  sources.near = dataset.near;
  sources.far = dataset.far;
  const splat::Gaussians gaussians = gaussians::initial_gaussians({}, sources, generator);
  const data::Dataset learned = run::with_learned_poses(dataset, poses, gaussians, {}, {});
  for (size_t i = 0; i < dataset.test.size(); ++i) {
    const geometry::Pose expected = geometry::moved(dataset.test[i].pose, motion);
    CHECK(geometry::rotation_angle(learned.test[i].pose, expected) < 1e-4);
    for (int k = 0; k < 3; ++k) {
      CHECK(learned.test[i].pose.translation[k] == Approx(expected.translation[k]).margin(1e-3));
    }
  }
}

TEST_CASE("learned cameras: a run keeps them, and scores, pictures and other programs use them",
          "[run]") {
  const LearnedRun scene;
  run::Trainer trainer(scene.options, scene.run, "");
  trainer.run();
  const auto file = scene.run / run::kCamerasFile;
  REQUIRE(std::filesystem::exists(file));

  const data::Dataset given = data::load_dataset(scene.options.dataset);
  const train::RunOptions saved = run::load_run_options(scene.run);
  const run::FinishedRun opened = run::open_run(scene.run, saved);
  const torch::Tensor learned = run::learned_path(*trainer.state().poses, 1, given.train[1])[3];
  const auto read = geometry::to_tensor(opened.dataset.train[1].poses[3]).to(torch::kFloat32);
  CHECK((read - learned).abs().max().item<double>() < 1e-6);
  CHECK(error_px(opened.dataset.test[0].pose, given.test[0].pose, given.test[0]) > 1e-3);

  const eval::Lpips lpips(torch::kCPU);
  const splat::RenderOptions draw = train::render_options(saved);
  const auto again = run::evaluate_views(opened.gaussians, opened.dataset.test, lpips, draw);
  CHECK(again.mean.psnr == Approx(trainer.evaluate().mean.psnr).epsilon(1e-6));
  const auto data_poses = run::evaluate_views(opened.gaussians, given.test, lpips, draw);
  CHECK(again.mean.psnr > data_poses.mean.psnr);
  // Overridden settings of the run do not move its scene back.
  train::RunOptions given_options = scene.options;
  given_options.poses.optimize = PosePath::kNone;
  const data::Dataset still = run::load_run_dataset(scene.run, given_options);
  CHECK(still.test[0].pose.translation == opened.dataset.test[0].pose.translation);
}

TEST_CASE("learned cameras: the file is in the coordinates of the data set", "[run]") {
  const LearnedRun scene;
  data::Dataset dataset = data::load_dataset(scene.options.dataset);
  dataset.origin = {471234, 5431987, 312};
  const data::Dataset given = dataset;
  const auto file = scene.dir / "cameras.json";
  run::write_cameras(file, dataset);
  const auto centre = geometry::centre(data::read_cameras(file).at(0).camera_from_world);
  const auto want = geometry::centre(dataset.test.at(0).pose);
  CHECK(centre[1] == Approx(want[1] + 5431987).epsilon(1e-12));
  run::read_learned_cameras(file, dataset);
  for (size_t axis = 0; axis < 3; ++axis) {
    CHECK(dataset.test[0].pose.translation[axis] ==
          Approx(given.test[0].pose.translation[axis]).margin(1e-7));
  }
}

TEST_CASE("learned cameras: a file of another split is refused, with what to set", "[run]") {
  const LearnedRun scene;
  data::Dataset dataset = data::load_dataset(scene.options.dataset);
  const auto file = scene.dir / "cameras.json";
  run::write_cameras(file, dataset);
  dataset.held_out.push_back(dataset.train.front());
  dataset.train.erase(dataset.train.begin());
  CHECK_THROWS_NAMING(DataError, run::read_learned_cameras(file, dataset),
                      "set the data set, split and lists of the run");
}

TEST_CASE("learned cameras: before a run's end other programs have those of its checkpoint",
          "[run]") {
  const LearnedRun scene;
  run::Trainer trainer(scene.options, scene.run, "");
  trainer.run();
  for (const char* made : {"point_cloud.ply", "eval.json", run::kCamerasFile}) {
    std::filesystem::remove(scene.run / made);
  }
  write_file(scene.run / "eval.json", "{}");  // as jade_eval leaves it
  const run::FinishedRun opened = run::open_run(scene.run, run::load_run_options(scene.run));
  const data::Dataset given = data::load_dataset(scene.options.dataset);
  const torch::Tensor learned = run::learned_path(*trainer.state().poses, 1, given.train[1])[3];
  const auto read = geometry::to_tensor(opened.dataset.train[1].poses[3]).to(torch::kFloat32);
  CHECK((read - learned).abs().max().item<double>() < 1e-6);
  CHECK(error_px(opened.dataset.train[1].poses[3], given.train[1].poses[3], given.test[0]) > 1e-3);
  CHECK(error_px(opened.dataset.test[0].pose, given.test[0].pose, given.test[0]) > 1e-3);
  // Poses and scene are from one checkpoint, the newest undamaged one.
  const auto newest = run::list_checkpoints(scene.run).front();
  const std::string bytes = read_file(newest);
  write_file(newest, bytes.substr(0, bytes.size() / 2));
  const run::FinishedRun before = run::open_run(scene.run, run::load_run_options(scene.run));
  const auto whole = run::list_checkpoints(scene.run).at(1);
  CHECK(torch::equal(before.gaussians.means, run::load_checkpoint_scene(whole).gaussians.means));
  CHECK(before.dataset.train[1].poses[3].translation !=
        opened.dataset.train[1].poses[3].translation);
  std::filesystem::remove_all(scene.run / "checkpoints");
  const data::Dataset none = run::load_run_dataset(scene.run, scene.options);
  CHECK(none.test[0].pose.translation == given.test[0].pose.translation);
}

TEST_CASE("learned cameras: those of an earlier end are gone while a run goes on", "[run]") {
  const LearnedRun scene;
  const auto file = scene.run / run::kCamerasFile;
  run::Trainer(scene.options, scene.run, "").run();
  CHECK(std::filesystem::exists(file));
  train::RunOptions longer = scene.options;
  longer.train.iterations = 24;
  {
    run::Trainer going(longer, scene.run, "latest");
    set_interrupt_requested(true);
    CHECK_THROWS_AS(going.run(), Interrupted);
    set_interrupt_requested(false);
  }
  for (const char* made : {"point_cloud.ply", "eval.json", "report.html", run::kCamerasFile}) {
    CHECK_FALSE(std::filesystem::exists(scene.run / made));
  }
  run::Trainer(longer, scene.run, "latest").run();
  CHECK(std::filesystem::exists(file));

  // Interrupted within the last fit: no half-fitted poses remain.
  std::filesystem::remove(file);
  {
    run::Trainer ending(longer, scene.run, "latest");
    set_interrupt_requested(true);
    CHECK_THROWS_AS(ending.run(), Interrupted);
    set_interrupt_requested(false);
  }
  CHECK_FALSE(std::filesystem::exists(file));
}

TEST_CASE(
    "learned cameras: a run under way falls back to the data's poses; a file that lacks a "
    "view is refused",
    "[run]") {
  const LearnedRun scene;
  const data::Dataset given = data::load_dataset(scene.options.dataset);
  std::filesystem::create_directories(scene.run);
  write_file(scene.run / "config.yaml", "poses: {optimize: linear}\n");
  const data::Dataset dataset = run::load_run_dataset(scene.run, scene.options);
  CHECK(dataset.test[0].pose.translation == given.test[0].pose.translation);

  const auto file = scene.run / run::kCamerasFile;
  run::write_cameras(file, given);
  const data::Dataset same = run::load_run_dataset(scene.run, scene.options);
  CHECK(same.train[2].poses[8].translation == given.train[2].poses[8].translation);

  const auto cameras = data::read_cameras(file);
  CHECK(cameras.size() == given.test.size() + 9 * given.train.size());
  auto others = cameras;
  others.erase(others.begin());
  data::write_cameras(file, others);
  CHECK_THROWS_WITH(run::load_run_dataset(scene.run, scene.options),
                    Catch::Contains(given.test[0].name) && Catch::Contains("cameras.json"));
  others = cameras;
  others.pop_back();
  data::write_cameras(file, others);
  CHECK_THROWS_WITH(run::load_run_dataset(scene.run, scene.options), Catch::Contains("none"));

  // A run that has ended without the file, as older versions left it.
  std::filesystem::remove(file);
  write_file(scene.run / "point_cloud.ply", "");
  CHECK_THROWS_NAMING(DataError, run::load_run_dataset(scene.run, scene.options), "--resume");
}

TEST_CASE("learned cameras: test views that changed after the fit are named", "[run]") {
  const LearnedRun scene;
  run::Trainer(scene.options, scene.run, "").run();
  const auto said = [&] {
    set_log_file(scene.dir / "load.log");
    run::load_run_dataset(scene.run, scene.options);
    set_log_file({});
    const std::string text = read_file(scene.dir / "load.log");
    std::filesystem::remove(scene.dir / "load.log");
    return text;
  };
  CHECK_THAT(said(), !Catch::Contains("test views"));
  const std::string name = data::load_dataset(scene.options.dataset).test[0].name;
  const auto image = scene.data / "images_1" / (name + ".png");
  imaging::write_image(image, imaging::read_image(image).flip({2}));
  CHECK_THAT(said(), test::naming("other images or poses", name));
}

TEST_CASE("learned cameras: a held-out exposure is scored and its path fitted as one body",
          "[run]") {
  LearnedRun scene;
  write_file(scene.data / data::kHeldOutFile, "01\n");
  run::Trainer(scene.options, scene.run, "").run();
  const auto json = nlohmann::json::parse(read_file(scene.run / "eval.json"));
  CHECK(json["held_out"].size() == 1);
  CHECK(json["mean"]["psnr_reblur"] == json["held_out"][0]["psnr_reblur"]);
  const data::Dataset learned = run::load_run_dataset(scene.run, scene.options);
  const data::Dataset given = data::load_dataset(scene.options.dataset);
  REQUIRE(learned.held_out.size() == 1);
  const auto& a = learned.held_out[0].poses;
  const auto& b = given.held_out[0].poses;
  CHECK(a[4].translation != b[4].translation);
  for (size_t k = 1; k < 9; ++k) {
    const geometry::Pose moved = geometry::compose(a[k], geometry::inverse(a[0]));
    const geometry::Pose before = geometry::compose(b[k], geometry::inverse(b[0]));
    CHECK(geometry::rotation_angle(moved, before) < 1e-5);
  }
}
