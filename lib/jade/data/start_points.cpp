// SPDX-License-Identifier: Apache-2.0
#include "jade/data/start_points.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/readable.h"
#include "jade/data/frames.h"

namespace jade::data {
namespace {

using geometry::Vector3;

struct PosedCamera {
  geometry::Pose pose;
  geometry::Intrinsics camera;
};

std::vector<PosedCamera> cameras_of(const Dataset& data) {
  std::vector<PosedCamera> cameras;
  for (const auto* exposures : {&data.train, &data.held_out}) {
    for (const Exposure& exposure : *exposures) {
      cameras.push_back({exposure.poses[geometry::kMidPose], exposure.camera});
    }
  }
  for (const SharpView& view : data.test) cameras.push_back({view.pose, view.camera});
  return cameras;
}

bool is_in_picture(const Vector3& point, const geometry::Intrinsics& camera) {
  if (!(point[2] > 0)) return false;
  const double u = camera.fx * point[0] / point[2] + camera.cx;
  const double v = camera.fy * point[1] / point[2] + camera.cy;
  return u >= 0 && u < double(camera.width) && v >= 0 && v < double(camera.height);
}

/// Likely reason if points behind the cameras would be visible after a half turn about the x axes.
const char* wrong_axes(DatasetKind kind) {
  if (kind == DatasetKind::kTransforms) {
    return "the poses seem to be in OpenCV axes (y down, z forwards), expected are those of OpenGL "
           "(y up, z backwards)";
  }
  if (kind == DatasetKind::kEvDeblur) {
    return "the poses seem to be in OpenCV axes, expected are those of LLFF (down, right, "
           "backwards)";
  }
  return "the poses seem to be in OpenGL axes (y up, z backwards), expected are those of OpenCV (y "
         "down, z forwards)";
}

/// Moves the value at share `q` of the sorted list there, and returns it.
double quantile(std::vector<double>& values, double q) {
  const auto at = values.begin() + std::ptrdiff_t(q * double(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Distance along an axis of a picture between the 5 % and 95 % quantiles of the places.
double width_of(std::vector<double>& places) {
  const double low = quantile(places, 0.05);
  return quantile(places, 0.95) - low;
}

/// How the cameras see some of the points.
struct Sight {
  double seen = 0;         ///< share of the points that are in any picture
  double behind = 0;       ///< share of the pairs of a point and a camera with it behind
  double pairs_seen = 0;   ///< share of the pairs with the point in the picture
  double turned_seen = 0;  ///< the same after a half turn of the cameras about their x axes
  double cameras = 1;      ///< share of the cameras that see any
  double width = 1;        ///< median over pictures of the width or height that the points fill
  double depth = 0;        ///< median depth where seen
};

Sight sight_of(const torch::Tensor& points, const std::vector<PosedCamera>& cameras) {
  constexpr int64_t kMostPairs = 1000000;
  constexpr size_t kFewest = 10;
  const torch::Tensor xyz = points.to(torch::kFloat64).contiguous();
  const double* const point = xyz.const_data_ptr<double>();
  const int64_t all = xyz.size(0) * int64_t(cameras.size());
  const int64_t step = 1 + all / kMostPairs;
  std::vector<char> seen(size_t((xyz.size(0) + step - 1) / step), 0);
  std::vector<double> depths, widths;
  int64_t behind = 0, pairs_seen = 0, turned_seen = 0, seeing = 0;
  for (const auto& [pose, camera] : cameras) {
    std::vector<double> columns, rows;
    for (size_t i = 0; i < seen.size(); ++i) {
      const double* const place = point + 3 * int64_t(i) * step;
      const Vector3 p = geometry::transform(pose, {place[0], place[1], place[2]});
      if (!(p[2] > 0)) ++behind;
      if (is_in_picture({p[0], -p[1], -p[2]}, camera)) ++turned_seen;
      if (!is_in_picture(p, camera)) continue;
      seen[i] = 1;
      depths.push_back(p[2]);
      columns.push_back(camera.fx * p[0] / p[2] / double(camera.width));
      rows.push_back(camera.fy * p[1] / p[2] / double(camera.height));
    }
    pairs_seen += int64_t(columns.size());
    seeing += columns.empty() ? 0 : 1;
    if (columns.size() >= kFewest) widths.push_back(std::max(width_of(columns), width_of(rows)));
  }
  const double pairs = double(seen.size() * cameras.size());
  Sight sight;
  sight.seen = double(std::count(seen.begin(), seen.end(), 1)) / double(seen.size());
  sight.cameras = double(seeing) / double(cameras.size());
  sight.behind = double(behind) / pairs;
  sight.pairs_seen = double(pairs_seen) / pairs;
  sight.turned_seen = double(turned_seen) / pairs;
  if (!widths.empty()) sight.width = quantile(widths, 0.5);
  if (!depths.empty()) sight.depth = quantile(depths, 0.5);
  return sight;
}

/// Median distance of the cameras from their middle.
double spread_of(const std::vector<PosedCamera>& cameras) {
  Vector3 middle{};
  std::vector<Vector3> centres;
  for (const PosedCamera& each : cameras) {
    centres.push_back(geometry::centre(each.pose));
    for (size_t axis = 0; axis < 3; ++axis) {
      middle[axis] += centres.back()[axis] / double(cameras.size());
    }
  }
  std::vector<double> away;
  for (const Vector3& c : centres) {
    away.push_back(std::hypot(c[0] - middle[0], c[1] - middle[1], c[2] - middle[2]));
  }
  return quantile(away, 0.5);
}

double percent(double share) {
  return share < 0.1 ? 0.1 * std::round(1000 * share) : std::round(100 * share);
}

/// The fault of the points with its fix; empty if they fit.
std::string fault_of(const Sight& sight, double spread, DatasetKind kind) {
  constexpr double kMostBehind = 0.9, kPairsSeen = 0.01, kTurnedSeen = 0.1;
  constexpr double kFewSeen = 0.2;  // structure from motion: nearly all are seen
  constexpr double kFewCameras = 0.2;
  constexpr double kSpot = 0.03;     // of the pictures' width
  constexpr double kFarthest = 200;  // structure from motion keeps angles above about a degree
  if (sight.behind > kMostBehind && sight.pairs_seen < kPairsSeen) {
    return concat("found ", std::lround(100 * sight.behind), " % of them behind the cameras; ",
                  sight.turned_seen >= kTurnedSeen
                      ? wrong_axes(kind)
                      : "are points and poses of one scene, and the poses in the axes and the "
                        "direction of their format?");
  }
  if (sight.seen < kFewSeen) {
    return concat("found ", percent(sight.seen), " % of them in any picture; are points and poses ",
                  "of one scene, in the same axes and the same unit?");
  }
  if (sight.cameras < kFewCameras) {
    return concat("found none in ", percent(1 - sight.cameras),
                  " % of the pictures; are points and poses of one scene, in the same axes and the "
                  "same unit?");
  }
  if (sight.width < kSpot) {
    return concat("found them all within ", percent(sight.width),
                  " % of the pictures' width; are points and poses in the same unit?");
  }
  if (spread > 0 && sight.depth > kFarthest * spread) {
    return concat("found them ", readable(sight.depth / spread, 2),
                  " times as far away as the cameras are from their middle; are points and poses ",
                  "in the same unit?");
  }
  return "";
}

}  // namespace

void drop_absurd_points(const std::string& where, const Warnings& warnings, torch::Tensor& points,
                        torch::Tensor& colors) {
  constexpr double kMostTimes = 1e6;
  const torch::Tensor xyz = points.to(torch::kFloat64), finite = xyz.isfinite().all(1);
  torch::Tensor keep = finite;
  if (finite.any().item<bool>()) {
    const torch::Tensor middle = std::get<0>(xyz.index({finite}).median(0));
    const torch::Tensor away = (xyz - middle).norm(2, 1);
    const torch::Tensor usual = away.index({finite}).median();
    keep = finite.logical_and(away.le(kMostTimes * usual).logical_or(usual.eq(0)));
  }
  const int64_t left = keep.numel() - keep.sum().item<int64_t>();
  if (left == 0) return;
  warnings.add(where, ": expected finite points near one another, found ", left, " of ",
               keep.numel(),
               " not finite or over a million times as far away as most; they are left out, remove "
               "them from the file");
  points = points.index({keep}), colors = colors.index({keep});
}

void check_points(const Warnings& warnings, Dataset& data) {
  constexpr int64_t kFewestPoints = 10;
  constexpr double kNoneSeen = 0.01;
  if (!data.points.defined() || data.points.size(0) < kFewestPoints || data.train.empty()) return;
  const std::vector<PosedCamera> cameras = cameras_of(data);
  const Sight sight = sight_of(data.points, cameras);
  const std::string fault = fault_of(sight, spread_of(cameras), data.kind);
  if (fault.empty()) return;
  const bool useless = sight.seen < kNoneSeen;
  const char* const without =
      fault.back() == '?' ? " The scene starts without them" : "; the scene starts without them";
  warnings.add(data.root.string(), ": expected points that the cameras see, ", fault,
               useless ? without : "");
  if (!useless) return;
  data.points = data.point_colors = torch::Tensor();
  if (data.kind == DatasetKind::kEvDeblur) return;  // states its bounds
  std::vector<geometry::Pose> poses;
  for (const PosedCamera& each : cameras) poses.push_back(each.pose);
  const DepthBounds bounds = depth_bounds({}, poses);
  data.near = bounds.near;
  data.far = bounds.far;
}

}  // namespace jade::data
