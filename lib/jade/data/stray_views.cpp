// SPDX-License-Identifier: Apache-2.0
#include "jade/data/stray_views.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "jade/core/readable.h"
#include "jade/core/text.h"

namespace jade::data {
namespace {

using geometry::Vector3;

/// Median distance of the points from the cameras' middle; 0 without points.
double depth_of(const torch::Tensor& points, const Vector3& middle) {
  if (!points.defined() || points.size(0) == 0) return 0;
  const torch::Tensor at = torch::tensor({middle[0], middle[1], middle[2]}, torch::kFloat64);
  return (points.to(torch::kFloat64) - at).norm(2, 1).median().item<double>();
}

std::vector<Vector3> centres_of(const std::vector<geometry::Pose>& poses) {
  std::vector<Vector3> centres;
  for (const geometry::Pose& pose : poses) centres.push_back(geometry::centre(pose));
  return centres;
}

}  // namespace

geometry::CameraRegion camera_region(const std::vector<geometry::Pose>& poses,
                                     const torch::Tensor& points, double depth) {
  const std::vector<Vector3> centres = centres_of(poses);
  const Vector3 middle = geometry::camera_region(centres, 0).middle;
  return geometry::camera_region(centres, std::max(depth, depth_of(points, middle)));
}

std::vector<geometry::Pose> without_strays(const std::vector<geometry::Pose>& poses,
                                           const torch::Tensor& points, double depth) {
  const geometry::CameraRegion region = camera_region(poses, points, depth);
  std::vector<geometry::Pose> kept;
  for (const geometry::Pose& pose : poses) {
    if (region.contains(geometry::centre(pose))) kept.push_back(pose);
  }
  return kept;
}

void mark_strays(Dataset& data, const Warnings& warnings) {
  std::vector<geometry::Pose> middles, all;
  const auto visit = [&](const auto& look) {
    for (Exposure& exposure : data.train) look(exposure);
    for (Exposure& exposure : data.held_out) look(exposure);
  };
  visit([&](const Exposure& exposure) {
    middles.push_back(exposure.poses[geometry::kMidPose]);
    all.insert(all.end(), exposure.poses.begin(), exposure.poses.end());
  });
  for (const SharpView& view : data.test) {
    middles.push_back(view.pose);
    all.push_back(view.pose);
  }
  const double depth = data.kind == DatasetKind::kEvDeblur ? std::sqrt(data.near * data.far) : 0;
  // A wrong pose of a frame also moves the poses interpolated towards it, so look at frames first.
  geometry::CameraRegion region = camera_region(middles, data.points, depth);
  if (std::isinf(region.radius)) region = camera_region(all, data.points, depth);
  std::vector<std::string> names;
  double farthest = 0;
  const auto is_stray = [&](const geometry::Pose& pose) {
    const Vector3 c = geometry::centre(pose);
    if (region.contains(c)) return false;
    farthest = std::max(farthest, std::hypot(c[0] - region.middle[0], c[1] - region.middle[1],
                                             c[2] - region.middle[2]));
    return true;
  };
  visit([&](Exposure& exposure) {
    exposure.stray = std::count_if(exposure.poses.begin(), exposure.poses.end(), is_stray) > 0;
    if (exposure.stray) names.push_back(exposure.name);
  });
  for (const SharpView& view : data.test) {
    if (is_stray(view.pose)) names.push_back(view.name);
  }
  if (names.empty()) return;
  const auto is_marked = [](const Exposure& exposure) { return exposure.stray; };
  if (std::all_of(data.train.begin(), data.train.end(), is_marked)) {
    for (Exposure& exposure : data.train) exposure.stray = false;  // something must set the size
  }
  warnings.add(data.root.string(), ": expected cameras near each other or the scene, found ",
               names.size(), " of ", middles.size(), " views far from all others: ", listing(names),
               ", up to ", readable(farthest, 3), " units away, the others within ",
               readable(region.radius, 3),
               "; the size of the scene and the start leave them out; correct or remove their "
               "poses");
}

}  // namespace jade::data
