// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/gaussians/ply.h"
#include "jade/world/frame_source.h"
#include "jade/world/world.h"

namespace jade::simulate {

/// Renders the Gaussians of a file (gaussians/scene_file.h).
class GaussianSource : public world::FrameSource {
 public:
  /// @throws DataError naming the path for a file without Gaussians.
  explicit GaussianSource(const std::filesystem::path& path);
  /// Ignores `samples`. Depth is the expected depth, or world::kNoDepth where nothing is.
  void render(const geometry::Pose& camera_from_world, const geometry::Intrinsics& camera,
              int samples, world::SharpFrame& frame) const override;
  /// A rig in front of the Gaussians that looks along −z at their middle, at a distance equal to
  /// the width of their middle two thirds.
  world::CameraRig rig() const;

 private:
  gaussians::GaussianFile file_;
};

}  // namespace jade::simulate
