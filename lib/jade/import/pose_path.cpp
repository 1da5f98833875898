// SPDX-License-Identifier: Apache-2.0
#include "jade/import/pose_path.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "jade/core/check.h"

namespace jade::import {
namespace {

/// Centre, then rotation vector.
using Place = std::array<double, 6>;

/// Rotation vector of the shorter rotation.
geometry::Vector3 rotation_vector(const geometry::Matrix3& rotation) {
  const geometry::Quaternion q = geometry::quaternion_from_rotation(rotation);
  const double sine = std::hypot(q[1], q[2], q[3]);
  if (sine < 1e-12) return {2 * q[1], 2 * q[2], 2 * q[3]};
  const double factor = 2 * std::atan2(sine, q[0]) / sine;
  return {factor * q[1], factor * q[2], factor * q[3]};
}

/// A pose relative to `origin`: R = exp(ω) R_origin, and its centre in world axes.
Place place_of(const geometry::Pose& pose, const geometry::Pose& origin) {
  const geometry::Pose turn =
      geometry::compose({pose.rotation, {}}, geometry::inverse({origin.rotation, {}}));
  const auto w = rotation_vector(turn.rotation);
  const auto c = geometry::centre(pose);
  return {c[0], c[1], c[2], w[0], w[1], w[2]};
}

geometry::Pose pose_of(const Place& place, const geometry::Pose& origin) {
  const geometry::Pose turn{geometry::rotation_from_vector({place[3], place[4], place[5]}), {}};
  return geometry::pose_at_centre(geometry::compose(turn, {origin.rotation, {}}).rotation,
                                  {place[0], place[1], place[2]});
}

/// The mean of poses that are close together.
geometry::Pose mean_of(const std::vector<geometry::Pose>& poses) {
  const geometry::Pose& origin = poses.front();
  Place sum{};
  for (const geometry::Pose& pose : poses) {
    const Place place = place_of(pose, origin);
    for (size_t k = 0; k < sum.size(); ++k) sum[k] += place[k] / double(poses.size());
  }
  return pose_of(sum, origin);
}

/// The slope at b of the parabola through three values at distances `before` and `after`.
double slope(const std::array<double, 3>& values, double before, double after) {
  const double left = (values[1] - values[0]) / before, right = (values[2] - values[1]) / after;
  return (left * after + right * before) / (before + after);
}

/// The cubic from a to b with these slopes at both ends, over a span of `step`, s from 0 to 1.
double cubic(double a, double slope_a, double b, double slope_b, double step, double s) {
  const double s2 = s * s, s3 = s2 * s;
  return (2 * s3 - 3 * s2 + 1) * a + (s3 - 2 * s2 + s) * step * slope_a + (3 * s2 - 2 * s3) * b +
         (s3 - s2) * step * slope_b;
}

}  // namespace

PosePath::PosePath(std::vector<double> t_us, std::vector<geometry::Pose> poses)
    : t_us_(std::move(t_us)), poses_(std::move(poses)) {
  JADE_CHECK(t_us_.size() == poses_.size() && t_us_.size() >= 2,
             "expected two poses or more with a "
             "time each, found ",
             poses_.size(), " at ", t_us_.size(), " times");
  for (size_t i = 1; i < t_us_.size(); ++i) {
    JADE_CHECK(t_us_[i - 1] < t_us_[i], "times of the path do not increase");
  }
}

geometry::Pose PosePath::at(double t_us) const {
  const auto after = std::upper_bound(t_us_.begin() + 1, t_us_.end() - 1, t_us);
  const auto i = static_cast<size_t>(after - t_us_.begin()) - 1;
  const bool has_before = i > 0, has_behind = i + 2 < t_us_.size();
  const geometry::Pose& origin = poses_[i];
  const double step = t_us_[i + 1] - t_us_[i], s = (t_us - t_us_[i]) / step;
  const Place a = place_of(origin, origin), b = place_of(poses_[i + 1], origin);
  const Place before = has_before ? place_of(poses_[i - 1], origin) : a;
  const Place behind = has_behind ? place_of(poses_[i + 2], origin) : b;
  Place place;
  for (size_t k = 0; k < place.size(); ++k) {
    const double straight = (b[k] - a[k]) / step;
    double slope_a = straight, slope_b = straight;
    if (has_before) slope_a = slope({before[k], a[k], b[k]}, t_us_[i] - t_us_[i - 1], step);
    if (has_behind) slope_b = slope({a[k], b[k], behind[k]}, step, t_us_[i + 2] - t_us_[i + 1]);
    // At an end of the path, use the parabola through the last three poses.
    if (!has_before && has_behind) slope_a = 2 * straight - slope_b;
    if (!has_behind && has_before) slope_b = 2 * straight - slope_a;
    place[k] = cubic(a[k], slope_a, b[k], slope_b, step, s);
  }
  return pose_of(place, origin);
}

PosePath path_through(std::vector<std::pair<double, geometry::Pose>> timed, double apart_us) {
  std::stable_sort(timed.begin(), timed.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<double> times;
  std::vector<geometry::Pose> poses;
  for (size_t begin = 0, end = 0; begin < timed.size(); begin = end) {
    double sum_us = 0;
    std::vector<geometry::Pose> near;
    for (; end < timed.size() && (end == begin || timed[end].first - timed[begin].first < apart_us);
         ++end) {
      sum_us += timed[end].first;
      near.push_back(timed[end].second);
    }
    times.push_back(sum_us / double(near.size()));
    poses.push_back(mean_of(near));
  }
  return {times, poses};
}

}  // namespace jade::import
