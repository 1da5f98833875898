// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/world/frame_source.h"
#include "jade/world/world.h"

namespace jade::world {

/// Casts `samples` rays per pixel, at fixed positions inside it (a pixel's value does not depend on
/// threads or order), and averages them. Depth is the nearest of the samples.
class RayCaster : public FrameSource {
 public:
  explicit RayCaster(World scene) : world_(std::move(scene)) {}
  const World& world() const { return world_; }
  void render(const geometry::Pose& camera_from_world, const geometry::Intrinsics& camera,
              int samples, SharpFrame& frame) const override;

 private:
  World world_;
};

}  // namespace jade::world
