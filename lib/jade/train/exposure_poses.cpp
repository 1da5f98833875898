// SPDX-License-Identifier: Apache-2.0
#include "jade/train/exposure_poses.h"

#include <algorithm>
#include <cmath>

#include "jade/core/check.h"
#include "jade/geometry/se3.h"

namespace jade::train {
namespace {

torch::Tensor world_from_camera(const geometry::Pose& camera_from_world) {
  return geometry::to_tensor(geometry::inverse(camera_from_world));
}

/// Start and end of an exposure, and for a spline the same motion once before and once after, so
/// that the spline's middle segment runs along the line between them.
torch::Tensor first_guess(const data::Exposure& exposure, bool cubic) {
  const torch::Tensor start = world_from_camera(exposure.poses.front());
  const torch::Tensor end = world_from_camera(exposure.poses.back());
  if (!cubic) return torch::stack({start, end});
  const torch::Tensor motion = geometry::se3_inverse(start).matmul(end);
  return torch::stack(
      {start.matmul(geometry::se3_inverse(motion)), start, end, end.matmul(motion)});
}

/// The cumulative weights of the 2nd, 3rd, … control pose at u = 0, 1/8, …, 1, [9,K-1,1].
torch::Tensor cumulative_weights(int64_t control_poses) {
  const torch::Tensor u = torch::linspace(0, 1, geometry::kExposurePoses, torch::kFloat64);
  if (control_poses == 2) return u.view({-1, 1, 1});
  const torch::Tensor square = u * u, cube = square * u;
  return torch::stack({(5 + 3 * u - 3 * square + cube) / 6, (1 + 3 * u + 3 * square - 2 * cube) / 6,
                       cube / 6},
                      1)
      .unsqueeze(-1);
}

}  // namespace

double pose_lr(const PoseOptions& options, int64_t step) {
  if (options.lr <= 0) return 0;
  const double share =
      std::min(1.0, static_cast<double>(step) / static_cast<double>(options.lr_max_steps));
  const double start = std::log(options.lr), end = std::log(std::max(options.lr_final, 1e-300));
  return std::exp(start + (end - start) * share);
}

ExposurePoses::ExposurePoses(PosePath path, const std::vector<data::Exposure>& exposures) {
  std::vector<torch::Tensor> guesses;
  for (const data::Exposure& exposure : exposures) {
    guesses.push_back(first_guess(exposure, path == PosePath::kCubic));
  }
  guess_ = torch::stack(guesses);
  twists_ = register_parameter("twists",
                               torch::zeros({guess_.size(0), guess_.size(1), 6}, torch::kFloat64));
}

torch::Tensor ExposurePoses::forward(int64_t exposure, torch::Device device) const {
  JADE_CHECK(exposure >= 0 && exposure < guess_.size(0), "exposure ", exposure, " of ",
             guess_.size(0));
  const torch::Tensor control =
      guess_[exposure].matmul(geometry::se3_exp(twists_[exposure]));  // [K,4,4]
  const int64_t count = control.size(0);
  const torch::Tensor motions =
      geometry::se3_log(geometry::se3_inverse(control.narrow(0, 0, count - 1))
                            .matmul(control.narrow(0, 1, count - 1)));
  const torch::Tensor weights = cumulative_weights(count);
  torch::Tensor path = control[0].unsqueeze(0);
  for (int64_t i = 0; i + 1 < count; ++i) {
    path = path.matmul(geometry::se3_exp(weights.select(1, i) * motions[i]));
  }
  return geometry::se3_inverse(path).to(device, torch::kFloat32);
}

std::shared_ptr<ExposurePoses> make_exposure_poses(const PoseOptions& options,
                                                   const std::vector<data::Exposure>& exposures) {
  if (options.optimize == PosePath::kNone) return nullptr;
  return std::make_shared<ExposurePoses>(options.optimize, exposures);
}

}  // namespace jade::train
