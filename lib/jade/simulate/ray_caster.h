// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/simulate/frame_source.h"
#include "jade/simulate/scene.h"

namespace jade::simulate {

/// Casts `samples` rays a pixel, at fixed places inside it (a pixel's value does not depend on
/// threads or order), and averages them. Depth is the nearest of the samples.
class RayCaster : public FrameSource {
 public:
  explicit RayCaster(Scene scene) : scene_(std::move(scene)) {}
  const Scene& scene() const { return scene_; }
  void render(const geometry::Pose& camera_from_world, const geometry::Intrinsics& camera,
              int samples, SharpFrame& frame) const override;

 private:
  Scene scene_;
};

}  // namespace jade::simulate
