// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/train/exposure_poses.h"

namespace jade::run {

/// The cameras of a run that goes on. Where poses are learned, exposures stand as training has them
/// by now, and test views move along with them.
class LiveCameras {
 public:
  /// @param data   outlives this
  /// @param poses  those that are learned; nullptr where the data's stay
  LiveCameras(const data::Dataset& data, std::shared_ptr<const train::ExposurePoses> poses);

  bool are_learned() const { return poses_ != nullptr; }
  /// The data set with its cameras as update() and refit() have left them; stays at its place.
  const data::Dataset& dataset() const { return posed_; }

  /// Puts a camera, "train.3" or "test.0", where it stands now; any other name is none of ours. On
  /// the thread that trains, between two steps; waits for a GPU.
  void update(const std::string& camera);
  void update_all();
  /// Test views from now on move from where `posed` has them, fitted to their images, with the
  /// exposures from where it has those.
  void refit(const data::Dataset& posed);

 private:
  std::vector<geometry::Pose> path(size_t exposure) const;
  std::vector<geometry::Pose> middles() const;

  const data::Dataset& data_;
  std::shared_ptr<const train::ExposurePoses> poses_;
  data::Dataset posed_;
  std::vector<geometry::Pose> fitted_exposures_;  ///< at mid-exposure, when the test views
  std::vector<geometry::Pose> fitted_tests_;      ///< were here
};

}  // namespace jade::run
