// SPDX-License-Identifier: Apache-2.0
// The chain of cameras that Kalibr writes. Private to this folder.
#pragma once

#include "jade/config/document.h"
#include "jade/import/calibration.h"

namespace jade::import {

/// Reads cam0 and cam1 of a chain, and names its other cameras as unused.
/// @throws DataError naming the key of a value that is missing or not supported.
Calibration kalibr(const std::filesystem::path& path, const config::DocumentNode& root);

}  // namespace jade::import
