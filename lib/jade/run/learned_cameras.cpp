// SPDX-License-Identifier: Apache-2.0
#include "jade/run/learned_cameras.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/data/cameras.h"
#include "jade/geometry/alignment.h"
#include "jade/geometry/origin.h"
#include "jade/geometry/quadrature.h"
#include "jade/geometry/se3.h"
#include "jade/imaging/ssim.h"
#include "jade/losses/poses.h"
#include "jade/run/evaluate.h"
#include "jade/train/module_adam.h"
#include "jade/train/view.h"

namespace jade::run {
namespace {

/// Weight of SSIM in the loss of the fit, as in the published 3DGS.
constexpr double kFitDssim = 0.2;

/// A picture of the scene along a path: a sharp view from one pose, a blurry one from several.
struct Sight {
  torch::Tensor image;  ///< [3,H,W]
  geometry::Intrinsics camera;
  std::vector<geometry::Pose> path;
  std::vector<double> weights;  ///< weight of each pose in the picture
  torch::Tensor mask;           ///< as data::Exposure::mask
  std::optional<double> gain;   ///< of the image; no value: fitted
};

/// The render with the image's brightness and mask.
torch::Tensor as_in_image(const torch::Tensor& render, const torch::Tensor& image,
                          const torch::Tensor& mask, const std::optional<double>& gain) {
  const torch::Tensor shown = mask.defined() ? render * mask : render;
  if (!gain) return shown * fitted_gain(shown.detach(), image);
  return *gain == 1 ? shown : shown * *gain;
}

/// Moves the whole path to minimise the difference between the render and the image, starting at
/// the given path.
std::vector<geometry::Pose> fitted(const Sight& sight, const splat::Gaussians& gaussians,
                                   int64_t steps, const splat::RenderOptions& render,
                                   Progress& progress, bool may_end) {
  const torch::Device device = gaussians.means.device();
  std::vector<torch::Tensor> start;
  for (const geometry::Pose& pose : sight.path) {
    start.push_back(geometry::to_tensor(geometry::inverse(pose)));
  }
  const torch::Tensor weights = torch::tensor(sight.weights, torch::kFloat64).to(device);
  torch::Tensor mask, image = sight.image.to(device);
  if (sight.mask.defined()) {
    mask = sight.mask.to(device, torch::kFloat32);
    image = image * mask;
  }
  const imaging::SsimTarget target = imaging::ssim_target(image);
  splat::CameraBatch camera = train::camera_batch(sight.path, sight.camera, device);
  torch::Tensor twist = torch::zeros({6}, torch::kFloat64).requires_grad_();
  train::PoseOptions schedule;
  schedule.lr = 1e-3;
  schedule.lr_max_steps = std::max<int64_t>(1, steps);
  train::ModuleAdam adam({twist}, schedule.lr);
  std::vector<geometry::Pose> best = sight.path;
  double least = std::numeric_limits<double>::infinity();
  for (int64_t step = 1; step <= steps && !(may_end && interrupt_requested()); ++step) {
    std::vector<torch::Tensor> poses;
    for (const torch::Tensor& each : start) {
      poses.push_back(geometry::se3_inverse(each.matmul(geometry::se3_exp(twist))));
    }
    camera.camera_from_world = torch::stack(poses).to(device, torch::kFloat32);
    const torch::Tensor renders = splat::render(gaussians, camera, render).color;
    const torch::Tensor mean =
        poses.size() == 1 ? renders[0] : losses::weighted_mean(renders, weights);
    const torch::Tensor loss =
        imaging::l1_ssim(as_in_image(mean, image, mask, sight.gain), target, kFitDssim);
    if (const double value = loss.item<double>(); value < least) {
      least = value;
      for (size_t k = 0; k < poses.size(); ++k) best[k] = geometry::pose_from_tensor(poses[k]);
    }
    adam.zero_grad();
    loss.backward();
    adam.step(train::pose_lr(schedule, step));
    if (progress.step()) progress.show();
  }
  return best;
}

/// The test views, then the nine poses of each training exposure, then of each held-out one.
std::vector<data::NamedCamera> all_cameras(const data::Dataset& dataset) {
  std::vector<data::NamedCamera> cameras;
  if (!dataset.test.empty()) cameras = data::dataset_cameras(dataset, data::CameraSet::kTest, "");
  for (data::NamedCamera& camera : data::dataset_cameras(dataset, data::CameraSet::kExposure, "")) {
    cameras.push_back(std::move(camera));
  }
  for (const data::Exposure& exposure : dataset.held_out) {
    for (size_t k = 0; k < exposure.poses.size(); ++k) {
      cameras.push_back({concat(exposure.name, "_", k), exposure.poses[k], exposure.camera});
    }
  }
  return cameras;
}

}  // namespace

torch::Tensor learned_path(const train::ExposurePoses& poses, int64_t index,
                           const data::Exposure& exposure) {
  const torch::NoGradGuard no_grad;
  const torch::Device device = poses.twists().device();
  const torch::Tensor data =
      train::camera_batch({exposure.poses.begin(), exposure.poses.end()}, exposure.camera, device)
          .camera_from_world;
  return poses
      .forward(torch::tensor({index}, torch::kInt64).to(device), train::pose_times(device), data)
      .cpu();
}

data::Dataset with_learned_poses(const data::Dataset& dataset, const train::ExposurePoses& poses,
                                 const splat::Gaussians& gaussians, const PoseFit& fit,
                                 const splat::RenderOptions& render) {
  const bool may_end = fit.on_interrupt == OnInterrupt::kEnd;
  const data::Dataset& from = fit.from != nullptr ? *fit.from : dataset;
  data::Dataset learned = dataset;
  std::vector<geometry::Pose> before, after;
  for (size_t i = 0; i < learned.train.size(); ++i) {
    const torch::Tensor path = learned_path(poses, static_cast<int64_t>(i), learned.train[i]);
    if (!path.isfinite().all().item<bool>()) {
      throw NumericError(concat("the learned poses of exposure ", learned.train[i].name,
                                " are not finite; lower poses.lr"));
    }
    data::Exposure& exposure = learned.train[i];
    before.push_back(from.train[i].poses[geometry::kMidPose]);
    for (size_t k = 0; k < exposure.poses.size(); ++k) {
      exposure.poses[k] = geometry::pose_from_tensor(path[static_cast<int64_t>(k)]);
    }
    after.push_back(exposure.poses[geometry::kMidPose]);
  }
  const geometry::Similarity drift = geometry::align_cameras(before, after);
  const auto views = static_cast<int64_t>(learned.test.size() + learned.held_out.size());
  Progress progress("fitting poses", views * fit.steps);
  const auto gain_of = [&](double gain) {
    return fit.gain ? std::nullopt : std::optional<double>(gain);
  };
  for (size_t i = 0; i < learned.test.size(); ++i) {
    data::SharpView& view = learned.test[i];
    view.pose = geometry::moved(from.test[i].pose, drift);
    view.pose = fitted({view.image, view.camera, {view.pose}, {1.0}, view.mask, gain_of(view.gain)},
                       gaussians, fit.steps, render, progress, may_end)[0];
  }
  for (size_t i = 0; i < learned.held_out.size(); ++i) {
    data::Exposure& exposure = learned.held_out[i];
    std::vector<geometry::Pose> path;
    for (const geometry::Pose& pose : from.held_out[i].poses) {
      path.push_back(geometry::moved(pose, drift));
    }
    const auto moments = geometry::quadrature(geometry::QuadratureRule::kTrapezoid, path.size());
    const auto found = fitted({exposure.blurry, exposure.camera, path, moments.weights,
                               exposure.mask, gain_of(exposure.gain)},
                              gaussians, fit.steps, render, progress, may_end);
    std::copy(found.begin(), found.end(), exposure.poses.begin());
  }
  return learned;
}

void write_learned_cameras(const std::filesystem::path& path, const data::Dataset& dataset) {
  std::vector<data::NamedCamera> cameras = all_cameras(dataset);
  const geometry::Vector3& o = dataset.origin;
  for (data::NamedCamera& camera : cameras) {
    camera.camera_from_world =
        geometry::with_origin(camera.camera_from_world, {-o[0], -o[1], -o[2]});
  }
  data::write_cameras(path, cameras);
}

void read_learned_cameras(const std::filesystem::path& path, data::Dataset& dataset) {
  const std::vector<data::NamedCamera> expected = all_cameras(dataset);
  std::vector<data::NamedCamera> found = data::read_cameras(path);
  for (data::NamedCamera& camera : found) {
    camera.camera_from_world = geometry::with_origin(camera.camera_from_world, dataset.origin);
  }
  const auto same = [](const data::NamedCamera& a, const data::NamedCamera& b) {
    return a.name == b.name && a.camera.width == b.camera.width &&
           a.camera.height == b.camera.height;
  };
  for (size_t i = 0; i < expected.size(); ++i) {
    if (i < found.size() && same(found[i], expected[i])) continue;
    throw DataError(concat(
        path.string(), ": expected camera ", expected[i].name, ", ", expected[i].camera.width, "x",
        expected[i].camera.height, ", as in the data set, found ",
        i < found.size() ? found[i].name : "none",
        "; are these the data of that run? If so, jade_train --resume writes the file again"));
  }
  size_t next = 0;
  for (data::SharpView& view : dataset.test) view.pose = found[next++].camera_from_world;
  for (data::Exposure& exposure : dataset.train) {
    for (geometry::Pose& pose : exposure.poses) pose = found[next++].camera_from_world;
  }
  for (data::Exposure& exposure : dataset.held_out) {
    for (geometry::Pose& pose : exposure.poses) pose = found[next++].camera_from_world;
  }
}

}  // namespace jade::run
