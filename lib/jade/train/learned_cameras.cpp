// SPDX-License-Identifier: Apache-2.0
#include "jade/train/learned_cameras.h"

#include <map>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/data/cameras.h"
#include "jade/geometry/alignment.h"
#include "jade/geometry/se3.h"
#include "jade/imaging/ssim.h"
#include "jade/splat/render.h"
#include "jade/train/module_adam.h"
#include "jade/train/view.h"

namespace jade::train {
namespace {

/// Share of SSIM in the loss of the fit; the one of the published 3DGS.
constexpr double kFitDssim = 0.2;

/// The pose from which the scene looks most like the image, near the pose given.
geometry::Pose fitted(const data::SharpView& view, const splat::Gaussians& gaussians,
                      const PoseOptions& options) {
  const torch::Device device = gaussians.means.device();
  const torch::Tensor start = geometry::to_tensor(geometry::inverse(view.pose));
  const imaging::SsimTarget target = imaging::ssim_target(view.image.to(device));
  splat::CameraBatch camera = camera_batch({view.pose}, view.camera, device);
  torch::Tensor twist = torch::zeros({6}, torch::kFloat64).requires_grad_();
  const auto camera_from_world = [&] {
    return geometry::se3_inverse(start.matmul(geometry::se3_exp(twist)));
  };
  ModuleAdam adam({twist}, options.lr);
  PoseOptions schedule = options;
  schedule.lr_max_steps = options.test_fit_steps;
  for (int64_t step = 1; step <= options.test_fit_steps; ++step) {
    camera.camera_from_world = camera_from_world().unsqueeze(0).to(device, torch::kFloat32);
    const torch::Tensor render = splat::render(gaussians, camera, {}).color[0];
    adam.zero_grad();
    imaging::l1_ssim(render, target, kFitDssim).backward();
    adam.step(pose_lr(schedule, step));
  }
  return geometry::pose_from_tensor(camera_from_world());
}

}  // namespace

data::Dataset with_learned_poses(const data::Dataset& dataset, const ExposurePoses& poses,
                                 const splat::Gaussians& gaussians, const PoseOptions& options) {
  data::Dataset learned = dataset;
  std::vector<geometry::Pose> before, after;
  for (size_t i = 0; i < learned.train.size(); ++i) {
    const torch::Tensor path = poses.forward(static_cast<int64_t>(i), torch::kCPU).detach();
    data::Exposure& exposure = learned.train[i];
    before.push_back(exposure.poses[geometry::kMidPose]);
    for (size_t k = 0; k < exposure.poses.size(); ++k) {
      exposure.poses[k] = geometry::pose_from_tensor(path[static_cast<int64_t>(k)]);
    }
    after.push_back(exposure.poses[geometry::kMidPose]);
  }
  const geometry::Similarity drift = geometry::align_cameras(before, after);
  for (data::SharpView& view : learned.test) {
    view.pose = geometry::moved(view.pose, drift);
    view.pose = fitted(view, gaussians, options);
  }
  return learned;
}

void write_learned_cameras(const std::filesystem::path& path, const data::Dataset& dataset) {
  std::vector<data::NamedCamera> cameras;
  for (const char* const which : {"test", "exposure"}) {
    if (dataset.test.empty() && std::string(which) == "test") continue;
    for (data::NamedCamera& camera : data::dataset_cameras(dataset, which, "")) {
      cameras.push_back(std::move(camera));
    }
  }
  data::write_cameras(path, cameras);
}

void read_learned_cameras(const std::filesystem::path& path, data::Dataset& dataset) {
  std::map<std::string, geometry::Pose> poses;
  for (const data::NamedCamera& camera : data::read_cameras(path)) {
    poses[camera.name] = camera.camera_from_world;
  }
  const auto pose_of = [&](const std::string& name) {
    const auto found = poses.find(name);
    if (found == poses.end()) {
      throw DataError(concat(path.string(), ": expected a camera named ", name,
                             " as in the data set, found none; train again or remove the file"));
    }
    return found->second;
  };
  for (data::SharpView& view : dataset.test) view.pose = pose_of(view.name);
  for (data::Exposure& exposure : dataset.train) {
    for (size_t k = 0; k < exposure.poses.size(); ++k) {
      exposure.poses[k] = pose_of(data::pose_name(exposure, k));
    }
  }
}

}  // namespace jade::train
