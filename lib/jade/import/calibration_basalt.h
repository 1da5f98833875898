// SPDX-License-Identifier: Apache-2.0
// The JSON of basalt_calibrate. Private to this folder.
#pragma once

#include <filesystem>

#include "jade/config/document.h"
#include "jade/import/calibration.h"

namespace jade::import {

/// The list of cameras in {"value0": {"intrinsics": [{"camera_type": "kb4", …}, …]}}; nullptr for
/// other files.
const config::DocumentNode* basalt_intrinsics(const config::DocumentNode& root);

/// Reads the first two cameras and names the others as unused.
/// @param intrinsics  of basalt_intrinsics(root)
/// @throws DataError for a model other than kb4, pinhole and pinhole-radtan8.
Calibration read_basalt(const std::filesystem::path& path, const config::DocumentNode& intrinsics,
                        const config::DocumentNode& root);

}  // namespace jade::import
