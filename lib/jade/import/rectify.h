// SPDX-License-Identifier: Apache-2.0
// Rectifies frames and events of a recording, from one or two cameras with lenses, to one centred
// pinhole.
#pragma once

#include <optional>
#include <torch/types.h>

#include "jade/geometry/rectification.h"

namespace jade::import {

/// Calibrated cameras of a recording.
struct RectifyCameras {
  geometry::LensCamera frames;
  /// The event camera and its pose; no value if one sensor records both.
  std::optional<geometry::Rig> events = std::nullopt;
};

struct RectifyOptions {
  geometry::RectifiedField field = geometry::RectifiedField::kFilled;
  /// For two cameras: depth at which events are mapped exactly, and the depth range of the scene,
  /// in the unit of the rig's translation. Defaults: near is half of plane_depth, far is infinity.
  double plane_depth = 0, near = 0, far = 0;
};

/// Maps that rectify a recording to one pinhole.
struct Rectification {
  geometry::Intrinsics camera;         ///< of frames and events after rectification
  torch::Tensor frame_map;             ///< [2,H,W], for imaging::remap
  torch::Tensor event_map;             ///< [2,h,w], for events::warp
  geometry::Parallax at_near, at_far;  ///< for two cameras: remaining error; zero for one sensor
};

/// @throws ConfigError for two cameras without a plane's depth, or if it is not between near and
///   far.
Rectification rectification(const RectifyCameras& cameras, const RectifyOptions& options);

}  // namespace jade::import
