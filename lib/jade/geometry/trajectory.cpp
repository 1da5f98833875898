// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/trajectory.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "jade/core/check.h"

namespace jade::geometry {
namespace {

/// Slopes at the knots of the not-a-knot cubic through (t_i, y_i), with at least 4 knots: third
/// derivatives are continuous at the second and the last but one knot. One tridiagonal system,
/// solved in place.
std::vector<double> not_a_knot_slopes(const std::vector<double>& t, const std::vector<double>& y) {
  const size_t n = t.size();
  std::vector<double> h(n - 1), m(n - 1);
  for (size_t i = 0; i + 1 < n; ++i) {
    h[i] = t[i + 1] - t[i];
    m[i] = (y[i + 1] - y[i]) / h[i];
  }
  std::vector<double> lower(n), diagonal(n), upper(n), right(n);
  const double first = h[0] + h[1], last = h[n - 3] + h[n - 2];
  diagonal[0] = h[1];
  upper[0] = first;
  right[0] = ((h[0] + 2 * first) * h[1] * m[0] + h[0] * h[0] * m[1]) / first;
  for (size_t i = 1; i + 1 < n; ++i) {
    lower[i] = h[i];
    diagonal[i] = 2 * (h[i - 1] + h[i]);
    upper[i] = h[i - 1];
    right[i] = 3 * (h[i] * m[i - 1] + h[i - 1] * m[i]);
  }
  lower[n - 1] = last;
  diagonal[n - 1] = h[n - 3];
  right[n - 1] =
      (h[n - 2] * h[n - 2] * m[n - 3] + (2 * last + h[n - 2]) * h[n - 3] * m[n - 2]) / last;
  for (size_t i = 1; i < n; ++i) {
    const double factor = lower[i] / diagonal[i - 1];
    diagonal[i] -= factor * upper[i - 1];
    right[i] -= factor * right[i - 1];
  }
  std::vector<double> slopes(n);
  slopes[n - 1] = right[n - 1] / diagonal[n - 1];
  for (size_t i = n - 1; i-- > 0;) slopes[i] = (right[i] - upper[i] * slopes[i + 1]) / diagonal[i];
  return slopes;
}

/// Slopes at the knots of the curve through the points; see Trajectory for fewer than 4 points.
std::vector<double> knot_slopes(const std::vector<double>& t, const std::vector<double>& y) {
  const size_t n = t.size();
  if (n == 1) return {0};
  if (n > 3) return not_a_knot_slopes(t, y);
  const double m0 = (y[1] - y[0]) / (t[1] - t[0]);
  if (n == 2) return {m0, m0};
  const double m1 = (y[2] - y[1]) / (t[2] - t[1]);
  const double curvature = (m1 - m0) / (t[2] - t[0]);
  return {m0 - curvature * (t[1] - t[0]), m0 + curvature * (t[1] - t[0]),
          m1 + curvature * (t[2] - t[1])};
}

/// `inner` mirrored at `end`: the pose as long before `end` as `inner` is after it, for constant
/// velocity.
Pose mirrored(const Pose& end, const Pose& inner) {
  const auto turn_back = compose(end, inverse(inner)).rotation;
  const Pose rotated = compose({turn_back, {0, 0, 0}}, end);
  const auto a = centre(end);
  const auto b = centre(inner);
  return pose_at_centre(rotated.rotation, {2 * a[0] - b[0], 2 * a[1] - b[1], 2 * a[2] - b[2]});
}

}  // namespace

std::array<double, kExposurePoses> exposure_times(int64_t t_start_us, int64_t t_end_us) {
  JADE_CHECK(t_end_us >= t_start_us, "expected an exposure that ends after it starts, found [",
             t_start_us, ", ", t_end_us, ") us");
  std::array<double, kExposurePoses> out{};
  for (int k = 0; k < kExposurePoses; ++k) {
    out[k] = double(t_start_us) + double(t_end_us - t_start_us) * k / (kExposurePoses - 1);
  }
  return out;
}

Trajectory::Trajectory(std::vector<double> t_us, const std::vector<Pose>& poses)
    : t_us_(std::move(t_us)) {
  JADE_CHECK(!poses.empty() && poses.size() == t_us_.size(),
             "expected as many poses as times and at least one, found ", poses.size(),
             " poses and ", t_us_.size(), " times");
  for (size_t i = 0; i < poses.size(); ++i) {
    JADE_CHECK(std::isfinite(t_us_[i]) && (i == 0 || t_us_[i] > t_us_[i - 1]),
               "expected strictly increasing pose times, found ", t_us_[i], " us at ", i);
    rotations_.push_back(quaternion_from_rotation(poses[i].rotation));
    centres_.push_back(centre(poses[i]));
  }
  fit_slopes();
}

void Trajectory::fit_slopes() {
  const size_t count = t_us_.size();
  slopes_.resize(count);
  std::vector<double> values(count);
  for (int axis = 0; axis < 3; ++axis) {
    for (size_t i = 0; i < count; ++i) {
      values[i] = centres_[i][axis];
      JADE_CHECK(std::isfinite(values[i]), "expected finite poses, found NaN or Inf at ", i);
    }
    const auto slopes = knot_slopes(t_us_, values);
    for (size_t i = 0; i < count; ++i) slopes_[i][axis] = slopes[i];
  }
}

void Trajectory::insert(size_t i, double t_us, const Pose& pose) {
  const auto place = static_cast<std::ptrdiff_t>(i);
  t_us_.insert(t_us_.begin() + place, t_us);
  rotations_.insert(rotations_.begin() + place, quaternion_from_rotation(pose.rotation));
  centres_.insert(centres_.begin() + place, centre(pose));
}

Pose Trajectory::at(double t_us) const {
  JADE_CHECK(!empty(), "an empty trajectory has no poses");
  const double t = std::clamp(t_us, begin_us(), end_us());
  if (t_us_.size() == 1)
    return pose_at_centre(rotation_from_quaternion(rotations_[0]), centres_[0]);
  const auto after = std::upper_bound(t_us_.begin() + 1, t_us_.end() - 1, t);
  const size_t i = size_t(after - t_us_.begin()) - 1;
  const double h = t_us_[i + 1] - t_us_[i], s = (t - t_us_[i]) / h;
  Vector3 c{};
  for (int axis = 0; axis < 3; ++axis) {  // cubic Hermite
    c[axis] = (1 + 2 * s) * (1 - s) * (1 - s) * centres_[i][axis] +
              s * (1 - s) * (1 - s) * h * slopes_[i][axis] +
              s * s * (3 - 2 * s) * centres_[i + 1][axis] +
              s * s * (s - 1) * h * slopes_[i + 1][axis];
  }
  return pose_at_centre(rotation_from_quaternion(slerp(rotations_[i], rotations_[i + 1], s)), c);
}

Trajectory Trajectory::spanning(double begin_us, double end_us) const {
  JADE_CHECK(!empty(), "an empty trajectory has no poses");
  const double first = this->begin_us(), last = this->end_us();
  Trajectory longer = *this;
  if (begin_us < first) longer.insert(0, begin_us, mirrored(at(first), at(2 * first - begin_us)));
  if (end_us > last)
    longer.insert(longer.t_us_.size(), end_us, mirrored(at(last), at(2 * last - end_us)));
  longer.fit_slopes();
  return longer;
}

std::array<Pose, kExposurePoses> Trajectory::exposure_poses(int64_t t_start_us,
                                                            int64_t t_end_us) const {
  std::array<Pose, kExposurePoses> out;
  const auto times = exposure_times(t_start_us, t_end_us);
  for (int k = 0; k < kExposurePoses; ++k) out[k] = at(times[k]);
  return out;
}

}  // namespace jade::geometry
