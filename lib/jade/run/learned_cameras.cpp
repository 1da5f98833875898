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
#include "jade/data/origin.h"
#include "jade/geometry/alignment.h"
#include "jade/geometry/origin.h"
#include "jade/geometry/quadrature.h"
#include "jade/geometry/se3.h"
#include "jade/geometry/trajectory.h"
#include "jade/imaging/ssim.h"
#include "jade/losses/poses.h"
#include "jade/train/module_adam.h"
#include "jade/train/view.h"

namespace jade::run {
namespace {

/// Weight of SSIM in the loss of the fit, as in the published 3DGS.
constexpr double kFitDssim = 0.2;

/// Renders per call of the fit: those of a held-out exposure.
constexpr size_t kMostRenders = geometry::kExposurePoses;

/// A picture of the scene along a path: a sharp view from one pose, a blurry one from several.
struct Sight {
  torch::Tensor image;  ///< [3,H,W]
  geometry::Intrinsics camera;
  std::vector<geometry::Pose> path;
  std::vector<double> weights;  ///< weight of each pose in the picture
  torch::Tensor mask;           ///< as data::Exposure::mask
  std::optional<double> gain;   ///< of the image; no value: fitted
};

/// Sights of one size and number of poses, on the device of the render.
struct SightBatch {
  splat::CameraBatch cameras;  ///< of N sights with P poses each: [N*P,4,4]
  torch::Tensor path;          ///< [N,P,4,4] float64, the poses at the start
  torch::Tensor weights;       ///< [P] float64
  std::vector<imaging::SsimTarget> targets;
  std::vector<torch::Tensor> masks;  ///< float32, undefined without one
  std::vector<std::optional<double>> gains;
};

bool may_share_batch(const Sight& a, const Sight& b) {
  return a.camera.width == b.camera.width && a.camera.height == b.camera.height &&
         a.weights == b.weights;
}

SightBatch batch_of(const std::vector<Sight>& sights, torch::Device device) {
  SightBatch batch;
  std::vector<torch::Tensor> paths, intrinsics;
  for (const Sight& sight : sights) {
    const splat::CameraBatch own = train::camera_batch(sight.path, sight.camera, device);
    paths.push_back(geometry::to_tensor(sight.path));
    intrinsics.push_back(own.intrinsics);
    batch.cameras.width = own.width;
    batch.cameras.height = own.height;
    torch::Tensor image = sight.image.to(device), mask;
    if (sight.mask.defined()) {
      mask = sight.mask.to(device, torch::kFloat32);
      image = image * mask;
    }
    batch.targets.push_back(imaging::ssim_target(image));
    batch.masks.push_back(mask);
    batch.gains.push_back(sight.gain);
  }
  batch.path = torch::stack(paths).to(device, torch::kFloat64);
  batch.cameras.intrinsics = torch::cat(intrinsics);
  batch.weights = torch::tensor(sights[0].weights, torch::kFloat64).to(device);
  return batch;
}

/// The rendered picture of a sight with its image's brightness and mask.
torch::Tensor as_in_image(const SightBatch& batch, size_t sight, const torch::Tensor& picture) {
  const torch::Tensor& mask = batch.masks[sight];
  const torch::Tensor shown = mask.defined() ? picture * mask : picture;
  const std::optional<double>& gain = batch.gains[sight];
  if (gain) return *gain == 1 ? shown : shown * *gain;
  const torch::Tensor constant = shown.detach();
  return shown *
         ((constant * batch.targets[sight].image).sum() / constant.square().sum().clamp_min(1e-12));
}

/// The loss of each sight, [N], and their sum, for cameras that receive a gradient.
imaging::L1SsimSum losses_of(const SightBatch& batch, const splat::CameraBatch& cameras,
                             const splat::Gaussians& gaussians,
                             const splat::RenderOptions& render) {
  const torch::Tensor renders = splat::render(gaussians, cameras, render).color;
  const int64_t poses = batch.path.size(1);
  std::vector<imaging::L1SsimTerm> terms;
  for (size_t i = 0; i < batch.targets.size(); ++i) {
    const auto first = static_cast<int64_t>(i) * poses;
    const torch::Tensor picture =
        poses == 1 ? renders[first]
                   : losses::weighted_mean(renders.narrow(0, first, poses), batch.weights);
    terms.push_back({{{as_in_image(batch, i, picture), batch.targets[i]}}, 1, {}});
  }
  return imaging::l1_ssim_sum(terms, kFitDssim);
}

/// Derivative of the loss with respect to a twist δ of each sight at 0, where each of its cameras
/// is exp(-δ) · camera_from_world: [N,6] float64.
/// @param cameras   [N,P,4,4] float64
/// @param gradient  of the loss with respect to them, the same shape
torch::Tensor twist_gradient(const torch::Tensor& cameras, const torch::Tensor& gradient) {
  const torch::Tensor g = gradient.narrow(2, 0, 3), m = cameras.narrow(2, 0, 3);
  const torch::Tensor turn = at::linalg_cross(m, g, 2).sum({1, 3});
  return -torch::cat({g.select(3, 3).sum(1), turn}, 1);
}

/// Moves the path of each sight as one body to minimise the difference between the render and the
/// image. Sights do not act on one another. The host never waits for the device.
/// @param unit  data::length_unit, for the step size of translations
std::vector<std::vector<geometry::Pose>> fitted(const std::vector<Sight>& sights,
                                                const splat::Gaussians& gaussians, int64_t steps,
                                                const splat::RenderOptions& render, double unit,
                                                Progress& progress, bool may_end) {
  SightBatch batch = batch_of(sights, gaussians.means.device());
  const auto count = static_cast<int64_t>(sights.size());
  const auto kind = batch.path.options();
  torch::Tensor path = batch.path, best = path, twist = torch::zeros({count, 6}, kind);
  const torch::Tensor units = geometry::twist_unit(unit).to(kind);
  torch::Tensor least = torch::full({count}, std::numeric_limits<double>::infinity(), kind);
  train::PoseOptions schedule;
  schedule.lr = 1e-3;
  schedule.lr_max_steps = std::max<int64_t>(1, steps);
  train::ModuleAdam adam({twist}, schedule.lr);
  for (int64_t step = 1; step <= steps && !(may_end && interrupt_requested()); ++step) {
    batch.cameras.camera_from_world =
        path.flatten(0, 1).to(torch::kFloat32).contiguous().requires_grad_();
    const imaging::L1SsimSum loss = losses_of(batch, batch.cameras, gaussians, render);
    loss.total.backward();
    const torch::NoGradGuard no_grad;
    const torch::Tensor now = loss.terms.detach().to(torch::kFloat64);
    best = torch::where((now < least).view({count, 1, 1, 1}), path, best);
    least = torch::minimum(least, now);
    twist.mutable_grad() =
        units *
        twist_gradient(
            path, batch.cameras.camera_from_world.grad().view(path.sizes()).to(torch::kFloat64));
    twist.zero_();
    adam.step(train::pose_lr(schedule, step));
    path = geometry::se3_exp(-twist * units).unsqueeze(1).matmul(path);
    if (progress.step(count)) progress.show();
  }
  const torch::Tensor found = best.cpu();
  std::vector<std::vector<geometry::Pose>> paths(sights.size());
  for (int64_t i = 0; i < count; ++i) {
    for (int64_t k = 0; k < found.size(1); ++k) {
      paths[static_cast<size_t>(i)].push_back(geometry::pose_from_tensor(found[i][k]));
    }
  }
  return paths;
}

/// fitted() for any sights, as many at once as one call may render.
std::vector<std::vector<geometry::Pose>> all_fitted(const std::vector<Sight>& sights,
                                                    const splat::Gaussians& gaussians,
                                                    int64_t steps,
                                                    const splat::RenderOptions& render, double unit,
                                                    bool may_end) {
  Progress progress("fitting poses", static_cast<int64_t>(sights.size()) * steps);
  std::vector<std::vector<geometry::Pose>> paths;
  for (size_t begin = 0; begin < sights.size();) {
    std::vector<Sight> some{sights[begin]};
    const size_t most = std::max<size_t>(1, kMostRenders / sights[begin].path.size());
    while (begin + some.size() < sights.size() && some.size() < most &&
           may_share_batch(sights[begin], sights[begin + some.size()])) {
      some.push_back(sights[begin + some.size()]);
    }
    for (auto& path : fitted(some, gaussians, steps, render, unit, progress, may_end)) {
      paths.push_back(std::move(path));
    }
    begin += some.size();
  }
  return paths;
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
  const auto gain_of = [&](double gain) {
    return fit.gain ? std::nullopt : std::optional<double>(gain);
  };
  std::vector<Sight> sights;
  for (size_t i = 0; i < learned.test.size(); ++i) {
    const data::SharpView& view = learned.test[i];
    sights.push_back({view.image,
                      view.camera,
                      {geometry::moved(from.test[i].pose, drift)},
                      {1.0},
                      view.mask,
                      gain_of(view.gain)});
  }
  for (size_t i = 0; i < learned.held_out.size(); ++i) {
    const data::Exposure& exposure = learned.held_out[i];
    std::vector<geometry::Pose> path;
    for (const geometry::Pose& pose : from.held_out[i].poses) {
      path.push_back(geometry::moved(pose, drift));
    }
    const auto moments = geometry::quadrature(geometry::QuadratureRule::kTrapezoid, path.size());
    sights.push_back({exposure.blurry, exposure.camera, std::move(path), moments.weights,
                      exposure.mask, gain_of(exposure.gain)});
  }
  const auto paths =
      all_fitted(sights, gaussians, fit.steps, render, data::length_unit(dataset), may_end);
  for (size_t i = 0; i < learned.test.size(); ++i) learned.test[i].pose = paths[i][0];
  for (size_t i = 0; i < learned.held_out.size(); ++i) {
    const auto& found = paths[learned.test.size() + i];
    std::copy(found.begin(), found.end(), learned.held_out[i].poses.begin());
  }
  return learned;
}

void write_cameras(const std::filesystem::path& path, const data::Dataset& dataset) {
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
    throw DataError(concat(path.string(), ": expected camera ", expected[i].name, ", ",
                           expected[i].camera.width, "x", expected[i].camera.height,
                           ", as in the data set, found ",
                           i < found.size() ? found[i].name : "none",
                           "; set the data set, split and lists of the run; if they are set, "
                           "jade_train --resume writes the file again"));
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
