// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"
#include "jade/recording/recording.h"

namespace jade::recording {

/// Writes events and frames in the RPG text layout: events.txt, images.txt (times marked by
/// recording.stamp; the middle of an exposure with known ends), images/NAME.png of 8 bits and
/// exposures.csv. With a camera also calib.txt and calibration.yaml, in OpenCV's format with
/// integer pixel centres. read_recording restores the same recording.
/// @param exposure_times  false: without exposures.csv, so that only the stamps are known
/// @throws DataError if a file cannot be written.
void write_rpg(const std::filesystem::path& folder, const Recording& recording,
               const std::optional<geometry::Intrinsics>& camera = std::nullopt,
               bool exposure_times = true);

/// Cameras without distortion, one for frames and one for events.
struct CameraPair {
  geometry::Intrinsics frames, events;
  geometry::Pose events_from_frames;
};

/// Writes camchain.yaml as Kalibr does, with integer pixel centres: cam0 took the frames, cam1 the
/// events. read_recording finds it in the folder.
/// @throws DataError if it cannot be written.
void write_camchain(const std::filesystem::path& folder, const CameraPair& cameras);

}  // namespace jade::recording
