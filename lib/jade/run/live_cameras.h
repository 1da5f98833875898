// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/train/exposure_poses.h"

namespace jade::run {

/// The cameras of a running training. If poses are learned, exposures have their current poses, and
/// test views move with them.
class LiveCameras {
 public:
  /// @param data   must outlive this
  /// @param poses  learned poses; nullptr if poses are not learned
  LiveCameras(const data::Dataset& data, std::shared_ptr<const train::ExposurePoses> poses);

  bool are_learned() const { return poses_ != nullptr; }
  /// The data set with cameras as of the last update() and refit(); its address is constant.
  const data::Dataset& dataset() const { return posed_; }

  /// Moves a camera, "train.3" or "test.0", to its current pose; ignores other names. Call it on
  /// the training thread, between two steps; waits for a GPU.
  void update(const std::string& camera);
  void update_all();
  /// Restarts test views from their fitted poses in `posed`, relative to its exposures.
  void refit(const data::Dataset& posed);

 private:
  std::vector<geometry::Pose> path(size_t exposure) const;
  std::vector<geometry::Pose> middles() const;

  const data::Dataset& data_;
  std::shared_ptr<const train::ExposurePoses> poses_;
  data::Dataset posed_;
  std::vector<geometry::Pose> fitted_exposures_;  ///< at mid-exposure, for which the test views
  std::vector<geometry::Pose> fitted_tests_;      ///< were fitted to these poses
};

}  // namespace jade::run
