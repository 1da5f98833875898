// SPDX-License-Identifier: Apache-2.0
// Frames and events of a recording, through a lens or two, as one centred pinhole sees them.
#pragma once

#include <optional>
#include <torch/types.h>

#include "jade/geometry/rectification.h"

namespace jade::import {

/// Calibrated cameras of a recording.
struct RectifyCameras {
  geometry::LensCamera frames;
  /// The event camera beside it; absent where one sensor gives both.
  std::optional<geometry::Rig> events = std::nullopt;
};

struct RectifyOptions {
  geometry::RectifiedField field = geometry::RectifiedField::kFilled;
  /// For a rig: depth at which events are mapped exactly, and the depth range of the scene, in the
  /// unit of the rig's translation. Defaults: near is half the plane's depth, far is far away.
  double plane_depth = 0, near = 0, far = 0;
};

/// How a recording is brought to one pinhole.
struct Rectification {
  geometry::Intrinsics camera;         ///< of frames and events from then on
  torch::Tensor frame_map;             ///< [2,H,W], for imaging::remap
  torch::Tensor event_map;             ///< [2,h,w], for events::warp
  geometry::Parallax at_near, at_far;  ///< of a rig: what the plane leaves; zero for one sensor
};

/// @throws ConfigError for a rig without a plane's depth, or with near and far that do not hold it.
Rectification rectification(const RectifyCameras& cameras, const RectifyOptions& options);

}  // namespace jade::import
