// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <utility>
#include <vector>

#include "jade/geometry/pose.h"

namespace jade::import {

/// A smooth way through poses that stand far apart: between two of them the cubic whose slopes at
/// both are those of the parabolas through three neighbours in time, for the centre and for the
/// rotation vector from the earlier pose alike. Poses three to an exposure leave turns between them
/// that a path of constant turns would cut off.
class PosePath {
 public:
  /// @param t_us   strictly increasing
  /// @param poses  camera_from_world, as many as times and at least two
  /// @throws ContractError otherwise.
  PosePath(std::vector<double> t_us, std::vector<geometry::Pose> poses);

  /// camera_from_world; beyond the ends the outermost cubic goes on.
  geometry::Pose at(double t_us) const;

  const std::vector<double>& t_us() const { return t_us_; }

 private:
  std::vector<double> t_us_;
  std::vector<geometry::Pose> poses_;
};

/// The path through poses in any order of time, where those that lie nearer to each other than
/// `apart_us` become one at their mean time and place: a sharp frame beside the restored middle of
/// the same exposure, say. The slope between two poses that are 1 us apart is their error alone,
/// and would throw the cubics beside them hundreds of pixels off.
/// @throws ContractError where fewer than two are left.
PosePath path_through(std::vector<std::pair<double, geometry::Pose>> timed, double apart_us);

}  // namespace jade::import
