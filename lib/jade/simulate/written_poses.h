// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/data/exposure.h"
#include "jade/geometry/trajectory.h"
#include "jade/simulate/footage.h"
#include "jade/simulate/options.h"
#include "jade/simulate/pose_error.h"

namespace jade::simulate {

/// Poses in the data set: the true ones, or those of a simulated reconstruction.
class WrittenPoses {
 public:
  WrittenPoses(const SimulateRun& run, const Footage& footage, const Timeline& timeline);

  /// The camera's path, which provides an exposure's nine poses. Except for PoseTimes::kPath it
  /// interpolates the estimated poses of the exposures.
  geometry::Pose path(int64_t t_us) const;
  /// Pose of a frame taken at that time: a separate estimate, which may differ from the path.
  geometry::Pose frame(int64_t t_us) const;

 private:
  const PoseNoiseOptions options_;
  const Footage& footage_;
  const PoseError error_;
  geometry::Trajectory through_exposures_;  // empty for PoseTimes::kPath
};

/// Image motion caused by pose errors, px: for points that the true camera sees at mid-exposure,
/// the distance between their projections by the written and the true pose. Root mean square over
/// points and poses, and the largest root mean square of one pose.
struct PoseErrorPx {
  double rms = 0, max = 0;
};
struct PoseErrors {
  PoseErrorPx mid;   ///< at mid-exposure
  PoseErrorPx nine;  ///< at all nine poses of the exposures
};

/// Errors of the exposures' written poses. If the footage has no depth, only rotations count.
/// @throws Interrupted.
PoseErrors pose_errors(const std::vector<data::Exposure>& exposures, const Footage& footage);

}  // namespace jade::simulate
