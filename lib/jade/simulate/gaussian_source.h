// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/gaussians/ply.h"
#include "jade/world/frame_source.h"
#include "jade/world/world.h"

namespace jade::simulate {

/// Splats the Gaussians of a file (gaussians/scene_file.h).
class GaussianSource : public world::FrameSource {
 public:
  /// @throws DataError naming the path for a file that holds no Gaussians.
  explicit GaussianSource(const std::filesystem::path& path);
  /// `samples` has no meaning here. Depth is the expected depth, world::kNoDepth where nothing is.
  void render(const geometry::Pose& camera_from_world, const geometry::Intrinsics& camera,
              int samples, world::SharpFrame& frame) const override;
  /// A rig in front of the Gaussians: it looks along −z at their middle, from as far as their
  /// middle two thirds are wide.
  world::CameraRig rig() const;

 private:
  gaussians::GaussianFile file_;
};

}  // namespace jade::simulate
