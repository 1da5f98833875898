// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/scene/ply.h"
#include "jade/simulate/frame_source.h"
#include "jade/simulate/scene.h"

namespace jade::simulate {

/// Splats the Gaussians of a .ply.
class GaussianSource : public FrameSource {
 public:
  /// @throws DataError naming the path for a file that holds no Gaussians.
  explicit GaussianSource(const std::filesystem::path& ply);
  /// `samples` has no meaning here. Depth is the expected depth, kNoDepth where nothing is.
  void render(const geometry::Pose& camera_from_world, const geometry::Intrinsics& camera,
              int samples, SharpFrame& frame) const override;
  /// A rig in front of the Gaussians: it looks along −z at their middle, from as far as their
  /// middle two thirds are wide.
  CameraRig rig() const;

 private:
  scene::GaussianFile file_;
};

}  // namespace jade::simulate
