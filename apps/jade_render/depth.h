// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>

#include "jade/splat/render.h"

namespace jade::apps {

/// Writes the depth of views along the camera's axis in units of the scene; 0 where more than half
/// of the light from behind the Gaussians passes.
class DepthFiles {
 public:
  /// @param step  units of the scene per step of the 16-bit .png
  DepthFiles(std::filesystem::path folder, double step);

  /// Writes NAME_depth.npy (float32 [1,H,W]) and NAME_depth.png (16 bits, rounded to steps).
  /// @param out  of one camera, with depth
  /// @throws DataError naming the path.
  void write(const std::string& name, const splat::RenderOutput& out);

  /// Warns if depths were too large for the .png.
  void finish() const;

 private:
  std::filesystem::path folder_;
  double step_;
  int64_t beyond_ = 0;   ///< pixels
  double farthest_ = 0;  ///< depth
};

}  // namespace jade::apps
