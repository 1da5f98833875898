// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "jade/geometry/camera.h"
#include "jade/recording/recording.h"

namespace jade::recording {

/// Writes events and frames in the RPG text layout: events.txt, images.txt (times as
/// recording.stamp says; the middle of an exposure whose ends are known), images/NAME.png of 8
/// bits and exposures.csv. With a camera also calib.txt and calibration.yaml, in OpenCV's format
/// and its pixels, whose centres are whole numbers. read_recording gives the same back.
/// @throws DataError if a file cannot be written.
void write_rpg(const std::filesystem::path& folder, const Recording& recording,
               const std::optional<geometry::Intrinsics>& camera = std::nullopt);

}  // namespace jade::recording
