// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"

namespace jade::world {

/// Depth where there is no surface.
constexpr float kNoDepth = 1e6f;

/// A sharp picture with its depth map.
struct SharpFrame {
  int64_t width = 0, height = 0;
  std::vector<float> rgb;    ///< [3,H,W], display-referred, in [0,1]
  std::vector<float> depth;  ///< [H,W], world units along the optical axis
  const float* channel(int c) const { return rgb.data() + c * width * height; }
  void resize(int64_t new_width, int64_t new_height);
};

/// Renders a static world from any pose.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  /// @param samples  rays per pixel, for sources that cast rays
  virtual void render(const geometry::Pose& camera_from_world, const geometry::Intrinsics& camera,
                      int samples, SharpFrame& frame) const = 0;
};

}  // namespace jade::world
