// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "jade/import/capture.h"
#include "jade/import/options.h"

namespace jade::import {

/// Brings frames and events to one centred pinhole, by the calibration of the options: of one
/// camera, or of two, the frames' first. @return one line that says what came out
/// @throws DataError for a calibration that cannot be read or is of another size, ConfigError for
///   two cameras without lens.plane_depth.
std::string undistort(const LensOptions& options, Capture& capture);

}  // namespace jade::import
