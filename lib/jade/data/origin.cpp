// SPDX-License-Identifier: Apache-2.0
#include "jade/data/origin.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/data/stray_views.h"

namespace jade::data {
namespace {

using geometry::Vector3;

double distance(const Vector3& a, const Vector3& b) {
  return std::sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                   (a[2] - b[2]) * (a[2] - b[2]));
}

Vector3 difference(const Vector3& a, const Vector3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

template <class Visit>
void for_exposures(Dataset& data, const Visit& visit) {
  for (Exposure& exposure : data.train) visit(exposure);
  for (Exposure& exposure : data.held_out) visit(exposure);
}

}  // namespace

Vector3 origin_of(const std::vector<geometry::Pose>& cameras_from_world,
                  const torch::Tensor& points, double depth) {
  if (cameras_from_world.empty()) return {0, 0, 0};
  const std::vector<geometry::Pose> near = without_strays(cameras_from_world, points, depth);
  std::vector<Vector3> centres;
  Vector3 middle{0, 0, 0};
  for (const geometry::Pose& pose : near) {
    centres.push_back(geometry::centre(pose));
    for (size_t axis = 0; axis < 3; ++axis) {
      middle[axis] += centres.back()[axis] / double(near.size());
    }
  }
  double size = std::isfinite(depth) ? depth : 0;
  for (const Vector3& centre : centres) size = std::max(size, distance(centre, middle));
  if (points.defined() && points.size(0) > 0) {
    size = std::max(size, with_origin(points, middle).norm(2, 1).median().item<double>());
  }
  // Cameras at one place differ by rounding only, which must not define the scene's size.
  constexpr double kRounding = 1e-12;
  if (size <= kRounding * distance(middle, {0, 0, 0})) size = 0;
  return geometry::scene_origin(middle, size);
}

torch::Tensor with_origin(const torch::Tensor& points, const Vector3& origin) {
  return points.to(torch::kFloat64) -
         torch::tensor({origin[0], origin[1], origin[2]}, torch::kFloat64);
}

void move_origin(Dataset& data, const Vector3& origin) {
  const Vector3 shift = difference(origin, data.origin);
  if (geometry::is_zero(shift)) return;
  for_exposures(data, [&](Exposure& exposure) {
    for (geometry::Pose& pose : exposure.poses) pose = geometry::with_origin(pose, shift);
  });
  for (SharpView& view : data.test) view.pose = geometry::with_origin(view.pose, shift);
  if (data.points.defined()) {
    data.points = with_origin(data.points, shift).to(data.points.scalar_type());
  }
  if (!data.trajectory.empty()) {
    const std::vector<double>& times = data.trajectory.times_us();
    std::vector<geometry::Pose> poses;
    for (const double time : times) {
      poses.push_back(geometry::with_origin(data.trajectory.at(time), shift));
    }
    data.trajectory = geometry::Trajectory(times, poses);
  }
  data.origin = origin;
}

double length_unit(const Dataset& data) {
  constexpr double kLeast = 0.1, kMost = 10;
  const double depth = std::sqrt(data.near * data.far);
  JADE_CHECK(depth > 0, "expected depth bounds above 0, found ", data.near, " and ", data.far);
  return depth >= kLeast && depth <= kMost ? 1 : depth;
}

void tell_origin(Dataset& data) {
  if (geometry::is_zero(data.origin)) return;
  const double far = distance(data.origin, {0, 0, 0});
  data.notes.push_back(
      concat("recentred on loading: the scene lies far from the origin of its coordinates, where "
             "float32 has steps of ",
             std::pow(2, std::floor(std::log2(far)) - 23), " units; poses and points are about (",
             geometry::text_of(data.origin),
             "); cameras.json and jade_export write the coordinates of the data set"));
}

void tell_still_cameras(const Dataset& data, const Warnings& warnings) {
  // A shift below a pixel; includes bounds that derive from the shift itself.
  constexpr double kStillShare = 1e-5, kStillAngle = 1e-6;
  if (data.train.size() < 2) return;
  const geometry::Pose& first = data.train.front().poses[0];
  double shift = 0, angle = 0;
  for (const Exposure& exposure : data.train) {
    for (const geometry::Pose& pose : exposure.poses) {
      shift = std::max(shift, distance(geometry::centre(pose), geometry::centre(first)));
      angle = std::max(angle, geometry::rotation_angle(pose, first));
    }
  }
  if (shift > kStillShare * data.near) return;
  warnings.add(data.root.string(), ": expected frames from several places, found ",
               data.train.size(),
               angle > kStillAngle ? " from one place" : " of one and the same pose",
               "; no depth can be learned from them. Are the poses those of the frames?");
}

}  // namespace jade::data
