// SPDX-License-Identifier: Apache-2.0
// Frames and events of a recording, through a lens or two, as one centred pinhole sees them.
#pragma once

#include <optional>
#include <torch/types.h>

#include "jade/events/event_stream.h"
#include "jade/geometry/rectification.h"

namespace jade::import {

/// What is known of the cameras.
struct RectifyCameras {
  geometry::LensCamera frames;
  /// The event camera beside it; absent where one sensor gives both.
  std::optional<geometry::Rig> events = std::nullopt;
};

struct RectifyOptions {
  geometry::RectifiedField field = geometry::RectifiedField::kFilled;
  /// Of a rig: where events are put right exactly, and the depths between which the scene lies, in
  /// the unit of the rig's translation. Not known: near is half the plane's depth, far is far away.
  double plane_depth = 0, near = 0, far = 0;
};

/// How a recording is brought to one pinhole.
struct Rectification {
  geometry::Intrinsics camera;         ///< of frames and events from then on
  torch::Tensor frame_map;             ///< [2,H,W], for imaging::remap
  torch::Tensor event_map;             ///< [2,h,w], for rectify_events
  geometry::Parallax at_near, at_far;  ///< of a rig: what the plane leaves; zero for one sensor
};

/// @throws ConfigError for a rig without a plane's depth, or with near and far that do not hold it.
Rectification rectification(const RectifyCameras& cameras, const RectifyOptions& options);

struct RectifiedEvents {
  events::EventStream events;
  int64_t dropped = 0;  ///< that no pixel of the image is within one pixel of
};

/// Moves events to the pinhole: (x, y) becomes map(x, y), bilinear between pixels for sub-pixel
/// coordinates; float coordinates, in order of time as they were. Any part of a recording can be
/// given by itself.
/// @param map   [2,h,w] float32 at the event sensor's size
/// @param size  of the pinhole's image
RectifiedEvents rectify_events(const events::EventStream& events, const torch::Tensor& map,
                               const events::ImageSize& size);

}  // namespace jade::import
