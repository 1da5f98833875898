// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"

namespace jade::serve {

/// A viewer's request.
struct Wanted {
  enum class Kind { kColor, kDepth, kPicture, kCamera };
  Kind kind = Kind::kColor;
  geometry::Pose pose;          ///< for kColor and kDepth, with
  geometry::Intrinsics camera;  ///< at most kMostPixels pixels
  /// A camera of the data set, "train.3": for kPicture and kCamera, and for a kColor at its
  /// mid-exposure pose, else empty.
  std::string view;
  std::string picture;  ///< for kPicture: "EDI"

  static constexpr int64_t kMostPixels = int64_t{1} << 22;
};

/// The value of a request's parameter; empty if it has none.
using Parameter = std::function<std::string(const char* name)>;

/// Parses a frame's request: `pose`, rows of camera_from_world, 12 numbers; `camera`, six: fx, fy,
/// cx, cy, width, height; `layer`, color or depth; optional `view`.
/// @throws ConfigError in one line.
Wanted wanted_frame(const Parameter& parameter);

/// Parses a picture's request: `view` and `name`.
/// @throws ConfigError in one line.
Wanted wanted_picture(const Parameter& parameter);

/// Parses a request for the current poses of a camera of the data set: `view`.
/// @throws ConfigError in one line.
Wanted wanted_camera(const Parameter& parameter);

/// `viewer`: 1 to 32 letters and digits, the same in all requests of one page.
/// @throws ConfigError in one line.
std::string viewer_of(const Parameter& parameter);

}  // namespace jade::serve
