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
  geometry::Pose pose;          ///< of kColor and kDepth, and
  geometry::Intrinsics camera;  ///< at most kMostPixels large
  /// A camera of the data set, "train.3": of kPicture and kCamera, and of a kColor that is taken
  /// there, at mid-exposure, else empty.
  std::string view;
  std::string picture;  ///< of kPicture: "EDI"

  static constexpr int64_t kMostPixels = int64_t{1} << 22;
};

/// The value of a request's parameter; empty where it has none.
using Parameter = std::function<std::string(const char* name)>;

/// Reads a frame's request: `pose`, rows of camera_from_world, 12 numbers; `camera`, six: fx, fy,
/// cx, cy, width, height; `layer`, color or depth; perhaps `view`.
/// @throws ConfigError in one line.
Wanted wanted_frame(const Parameter& parameter);

/// Reads a picture's request: `view` and `name`.
/// @throws ConfigError in one line.
Wanted wanted_picture(const Parameter& parameter);

/// Reads the question where a camera of the data set stands: `view`.
/// @throws ConfigError in one line.
Wanted wanted_camera(const Parameter& parameter);

/// `viewer`: 1 to 32 letters and digits, the same in all requests of one page.
/// @throws ConfigError in one line.
std::string viewer_of(const Parameter& parameter);

}  // namespace jade::serve
