// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"
#include "jade/recording/recording.h"

namespace jade::recording {

/// Writes events and frames in the RPG text layout: events.txt, images.txt (times as
/// recording.stamp says; the middle of an exposure whose ends are known), images/NAME.png of 8
/// bits and exposures.csv. With a camera also calib.txt and calibration.yaml, in OpenCV's format
/// and its pixels, whose centres are whole numbers. read_recording gives the same back.
/// @param exposure_times  false: without exposures.csv, so that only the stamps say when
/// @throws DataError if a file cannot be written.
void write_rpg(const std::filesystem::path& folder, const Recording& recording,
               const std::optional<geometry::Intrinsics>& camera = std::nullopt,
               bool exposure_times = true);

/// Cameras without distortion, one for frames and one for events.
struct CameraPair {
  geometry::Intrinsics frames, events;
  geometry::Pose events_from_frames;
};

/// Writes camchain.yaml as Kalibr does: cam0 took the frames, cam1 the events. Its pixels have
/// centres that are whole numbers. read_recording finds it in the folder.
/// @throws DataError if it cannot be written.
void write_camchain(const std::filesystem::path& folder, const CameraPair& cameras);

}  // namespace jade::recording
