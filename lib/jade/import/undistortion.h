// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "jade/import/calibration.h"
#include "jade/import/capture.h"
#include "jade/import/options.h"

namespace jade::import {

/// The calibration that the options name, else that which came with the recording, else none.
/// @param kept  file of the latter, or empty
/// @throws DataError for a file that cannot be read, ConfigError for two cameras without
///   lens.plane_depth, or a plane without two cameras.
std::optional<Calibration> calibration_of(const LensOptions& options,
                                          const std::filesystem::path& kept);

/// Frames and events come from two cameras, and agree only once they are undistorted.
bool is_rig(const std::optional<Calibration>& calibration);

/// Checks the sizes of frames and events against it. The sensor of a second camera has the size
/// that it was calibrated at, where the recording does not say one.
/// @throws DataError for another size.
void settle_sensor(const Calibration& calibration, Capture& capture);

/// Brings frames and events to one centred pinhole; of two cameras, the first took the frames.
/// @return one line that says what came out
/// @throws as settle_sensor().
std::string undistort(const LensOptions& options, const Calibration& calibration, Capture& capture);

}  // namespace jade::import
