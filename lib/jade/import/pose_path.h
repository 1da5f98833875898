// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <utility>
#include <vector>

#include "jade/geometry/pose.h"

namespace jade::import {

/// A smooth path through sparse poses: cubic segments whose slopes are those of the parabolas
/// through three consecutive poses, for the centre and for the rotation vector relative to the
/// earlier pose. With three poses per exposure, segments of constant angular velocity would cut
/// corners.
class PosePath {
 public:
  /// @param t_us   strictly increasing
  /// @param poses  camera_from_world, as many as times and at least two
  /// @throws ContractError otherwise.
  PosePath(std::vector<double> t_us, std::vector<geometry::Pose> poses);

  /// camera_from_world; extrapolates the outermost cubic beyond the ends.
  geometry::Pose at(double t_us) const;

  const std::vector<double>& t_us() const { return t_us_; }

 private:
  std::vector<double> t_us_;
  std::vector<geometry::Pose> poses_;
};

/// The path through unordered poses. Poses closer in time than `apart_us` are replaced by their
/// mean, for example a sharp frame and the restored middle of the same exposure: the slope between
/// poses 1 µs apart consists of their error alone, and would move the cubics beside them by
/// hundreds of pixels.
/// @throws ContractError if fewer than two remain.
PosePath path_through(std::vector<std::pair<double, geometry::Pose>> timed, double apart_us);

}  // namespace jade::import
