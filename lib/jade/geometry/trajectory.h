// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "jade/geometry/pose.h"

namespace jade::geometry {

/// Poses per exposure, at equal time steps from its start to its end, inclusive.
inline constexpr int kExposurePoses = 9;
/// The pose at mid-exposure.
inline constexpr int kMidPose = 4;

/// The nine times of [t_start, t_end] in µs, linspace(t_start, t_end, 9).
std::array<double, kExposurePoses> exposure_times(int64_t t_start_us, int64_t t_end_us);

/// A camera path through timed poses: slerp of rotations, and a not-a-knot cubic spline of camera
/// centres (not of translations, which depend on the rotation). Two poses give a line, three a
/// parabola, and one a constant.
class Trajectory {
 public:
  Trajectory() = default;

  /// @param t_us   strictly increasing.
  /// @param poses  camera_from_world, as many as times.
  /// @throws ContractError for no pose, counts that differ, times that do not increase, NaN.
  Trajectory(std::vector<double> t_us, const std::vector<Pose>& poses);

  /// camera_from_world at any time. Outside [begin_us, end_us] returns the nearest end.
  Pose at(double t_us) const;

  /// This path, extended by one pose if it does not reach `begin_us` or `end_us`: the path mirrored
  /// at its end, which is exact for constant velocity.
  Trajectory spanning(double begin_us, double end_us) const;

  /// The nine poses of an exposure; index kMidPose is mid-exposure.
  std::array<Pose, kExposurePoses> exposure_poses(int64_t t_start_us, int64_t t_end_us) const;

  bool empty() const { return t_us_.empty(); }
  int64_t size() const { return int64_t(t_us_.size()); }
  double begin_us() const { return t_us_.front(); }
  double end_us() const { return t_us_.back(); }
  const std::vector<double>& times_us() const { return t_us_; }

 private:
  void insert(size_t i, double t_us, const Pose& pose);
  void fit_slopes();

  std::vector<double> t_us_;
  std::vector<Quaternion> rotations_;
  std::vector<Vector3> centres_;
  std::vector<Vector3> slopes_;  ///< world units per µs at the knots
};

}  // namespace jade::geometry
