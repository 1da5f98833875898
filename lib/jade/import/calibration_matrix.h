// SPDX-License-Identifier: Apache-2.0
// Cameras by their matrix: OpenCV's storage, and the messages of ROS 1 and 2. Private to this
// folder.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "jade/import/calibration.h"
#include "jade/import/calibration_fields.h"

namespace jade::import {

/// Keys of one camera: OpenCV's storage, or the messages of ROS 1 or 2.
struct CameraKeys {
  std::string matrix, lens;
};

/// One entry per camera of this map. Stereo calibrations number the keys of both: M1 D1 M2 D2.
std::vector<CameraKeys> camera_keys(const config::DocumentNode& node);

enum class LensKind : uint8_t { kUnsaid, kNone, kPerspective, kFisheye };

/// Reads the lens type from all keys of one map: a flag such as fisheye_model, or a model's name.
/// @throws DataError naming the key of a model that is not supported or contradicts another key.
LensKind lens_kind(const Section& section);

/// @param around  the lens type given outside this section
/// @throws DataError naming the key of a value that is missing or not supported.
CalibratedCamera matrix_camera(const Section& section, const CameraKeys& keys, LensKind around);

}  // namespace jade::import
