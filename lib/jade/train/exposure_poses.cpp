// SPDX-License-Identifier: Apache-2.0
#include "jade/train/exposure_poses.h"

#include <algorithm>
#include <cmath>

#include "jade/core/check.h"
#include "jade/core/random.h"
#include "jade/data/origin.h"
#include "jade/geometry/exposure_path.h"
#include "jade/geometry/se3.h"
#include "jade/train/exposure_span.h"

namespace jade::train {
namespace {

torch::Tensor world_from_camera(const geometry::Pose& camera_from_world) {
  return geometry::to_tensor(geometry::inverse(camera_from_world));
}

/// Start and end of an exposure and, for a spline, the same motion once before and once after, so
/// that the spline's middle segment is the line between them.
torch::Tensor first_guess(const data::Exposure& exposure, bool cubic) {
  const torch::Tensor start = world_from_camera(exposure.poses.front());
  const torch::Tensor end = world_from_camera(exposure.poses.back());
  if (!cubic) return torch::stack({start, end});
  const torch::Tensor motion = geometry::se3_inverse(start).matmul(end);
  return torch::stack(
      {start.matmul(geometry::se3_inverse(motion)), start, end, end.matmul(motion)});
}

torch::Tensor first_guesses(const data::Dataset& dataset, bool cubic) {
  std::vector<torch::Tensor> guesses;
  for (const data::Exposure& exposure : dataset.train) {
    guesses.push_back(first_guess(exposure, cubic));
  }
  return torch::stack(guesses);
}

/// Poses at the control twists of a multi-segment spline, accurate enough for the gauge.
torch::Tensor poses_at_controls(const data::Dataset& dataset, int64_t control_poses) {
  std::vector<torch::Tensor> all;
  for (const ExposureSpan& span : exposure_spans(dataset)) {
    std::vector<geometry::Pose> poses;
    for (int64_t j = 0; j < control_poses; ++j) {
      const double u = static_cast<double>(j - 1) / static_cast<double>(control_poses - 3);
      poses.push_back(geometry::inverse(span.at(std::clamp(u, 0.0, 1.0))));
    }
    all.push_back(geometry::to_tensor(poses));
  }
  return torch::stack(all);
}

/// Initial twists [V,J,6], units of length and rad: zeros, but small random ones for frames without
/// events or motion. With equal poses every control pose has the same gradient up to a factor, so
/// the camera would stay at rest however blurred the frame is.
torch::Tensor first_twists(const data::Dataset& dataset, int64_t control_poses, double depth) {
  constexpr double kDeviation = 1e-3;  // a third of a pixel at a focal length of 350 px
  const auto views = static_cast<int64_t>(dataset.train.size());
  torch::Tensor twists = torch::zeros({views, control_poses, 6}, torch::kFloat64);
  if (!dataset.events.empty()) return twists;
  const torch::Tensor deviation =
      kDeviation * torch::tensor({depth, depth, depth, 1.0, 1.0, 1.0}, torch::kFloat64);
  at::Generator generator = make_generator(0, "first motion");  // the same for all seeds
  for (int64_t i = 0; i < views; ++i) {
    const data::Exposure& exposure = dataset.train[static_cast<size_t>(i)];
    if (!world_from_camera(exposure.poses.front()).equal(world_from_camera(exposure.poses.back())))
      continue;
    twists[i] = torch::randn({control_poses, 6}, generator, torch::kFloat64) * deviation;
  }
  return twists;
}

}  // namespace

double pose_lr(const PoseOptions& options, int64_t step) {
  if (options.lr <= 0) return 0;
  const double share =
      std::min(1.0, static_cast<double>(step) / static_cast<double>(options.lr_max_steps));
  const double start = std::log(options.lr),
               end = std::log(std::max(options.lr / kPoseLrFall, 1e-300));
  return std::exp(start + (end - start) * share);
}

ExposurePoses::ExposurePoses(const PoseOptions& options, const data::Dataset& dataset)
    : start_(options.start) {
  JADE_CHECK(options.optimize != PosePath::kNone, "expected a path that is learned, found none");
  const bool cubic = options.optimize == PosePath::kCubic;
  const bool bends = cubic && start_ == PoseStart::kData && options.control_poses > 4;
  const torch::Tensor control =
      bends ? poses_at_controls(dataset, options.control_poses) : first_guesses(dataset, cubic);
  const double depth = std::sqrt(dataset.near * dataset.far);
  if (const double unit = data::length_unit(dataset); unit != 1) {
    unit_ = register_buffer("unit", geometry::twist_unit(unit));
  }
  if (start_ == PoseStart::kLine) {
    control_ = register_buffer("control", control);
  } else {
    gauge_ = pose_gauge(control, depth);
    if (unit_.defined()) gauge_ = {gauge_.read * unit_, gauge_.write / unit_};
    gauge_.read = register_buffer("gauge_read", gauge_.read);
    gauge_.write = register_buffer("gauge_write", gauge_.write);
  }
  torch::Tensor twists = first_twists(dataset, control.size(1), depth);
  if (unit_.defined()) twists = twists / unit_;
  twists_ = register_parameter("twists", twists);
}

torch::Tensor ExposurePoses::forward(const torch::Tensor& exposure, const torch::Tensor& u,
                                     const torch::Tensor& data) const {
  check_shape(exposure, "exposure", {1});
  torch::Tensor twists = twists_.index_select(0, exposure).squeeze(0);
  if (unit_.defined()) twists = twists * unit_;
  const torch::Tensor path =
      start_ == PoseStart::kData
          ? geometry::corrected_path(twists, u, data)
          : geometry::spline_path(twists, u, control_.index_select(0, exposure).squeeze(0));
  return path.to(torch::kFloat32);
}

void ExposurePoses::hold_gauge() {
  if (start_ == PoseStart::kData) remove_gauge(gauge_, twists_);
}

std::shared_ptr<ExposurePoses> make_exposure_poses(const PoseOptions& options,
                                                   const data::Dataset& dataset) {
  if (options.optimize == PosePath::kNone) return nullptr;
  return std::make_shared<ExposurePoses>(options, dataset);
}

}  // namespace jade::train
