// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/data/exposure.h"
#include "jade/geometry/trajectory.h"
#include "jade/simulate/footage.h"
#include "jade/simulate/options.h"
#include "jade/simulate/pose_error.h"

namespace jade::simulate {

/// Poses as the data set has them: the true ones, or those of a reconstruction.
class WrittenPoses {
 public:
  WrittenPoses(const SimulateRun& run, const Footage& footage, const Timeline& timeline);

  /// The camera's path, from which an exposure gets its nine poses. But for PoseTimes::kPath it
  /// runs through the estimated poses of the exposures and knows no others.
  geometry::Pose path(int64_t t_us) const;
  /// Pose of a frame taken at that time: a separate estimate, which the path need not meet.
  geometry::Pose frame(int64_t t_us) const;

 private:
  const PoseNoiseOptions options_;
  const Footage& footage_;
  const PoseError error_;
  geometry::Trajectory through_exposures_;  // empty for PoseTimes::kPath
};

/// How far written poses move the picture, px: over the points that the true camera sees at
/// mid-exposure, the distance between where the written and the true pose put them. Root mean
/// square over points and poses, and the largest root mean square of one pose.
struct PoseErrorPx {
  double rms = 0, max = 0;
};
struct PoseErrors {
  PoseErrorPx mid;   ///< at mid-exposure
  PoseErrorPx nine;  ///< at all nine poses of the exposures
};

/// Errors of the exposures' written poses. If the footage has no depth, rotations alone count.
/// @throws Interrupted.
PoseErrors pose_errors(const std::vector<data::Exposure>& exposures, const Footage& footage);

}  // namespace jade::simulate
