// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <torch/types.h>

#include "jade/geometry/rectification.h"
#include "jade/import/calibration.h"
#include "jade/import/capture.h"
#include "jade/import/options.h"

namespace jade::import {

/// Calibrated cameras of a recording.
struct RectifyCameras {
  geometry::LensCamera frames;
  /// The event camera and its pose; no value if one sensor records both.
  std::optional<geometry::Rig> events = std::nullopt;
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
Rectification rectification(const RectifyCameras& cameras, const LensOptions& options);

/// The calibration that the options name, else the one beside the recording, else none.
/// @param kept file of the latter, or empty
/// @throws DataError for a file that cannot be read, ConfigError for two cameras without
///   lens.plane_depth, or lens.plane_depth without two cameras.
std::optional<Calibration> calibration_of(const LensOptions& options,
                                          const std::filesystem::path& kept);

/// Whether frames and events come from two cameras, so that they match only after undistortion.
bool is_rig(const std::optional<Calibration>& calibration);

/// Smallest image size that holds all events.
events::ImageSize reach_of(const events::EventStream& events);

/// Puts the camera of the frames first, with a warning if that exchanges the two or is in doubt,
/// and checks the sizes of frames and events against the calibration. If the recording does not
/// contain the size of a second camera's sensor, uses that of its calibration.
/// @throws DataError for another size.
void settle_sensor(Calibration& calibration, Capture& capture);

/// Undistorts frames and events to one centred pinhole; of two cameras, the first took the frames.
/// Frames finer than the event sensor are scaled to its pixels.
/// @return a one-line summary
/// @throws as settle_sensor().
std::string undistort(const LensOptions& options, const Calibration& calibration, Capture& capture);

}  // namespace jade::import
