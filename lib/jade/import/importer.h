// SPDX-License-Identifier: Apache-2.0
// Converts a recording to a data set with poses.
#pragma once

#include <filesystem>
#include <string>

#include "jade/import/options.h"
#include "jade/import/stages.h"

namespace jade::import {

/// Runs the stages read, time, sensor, undistort, restore, poses, vignetting and write, each in its
/// folder of OUTPUT/import, and writes the data set into OUTPUT. Shows progress.
/// @throws DataError for input that cannot be read, ordered or posed; ConfigError; Interrupted.
void import_recording(const ImportOptions& options, const std::filesystem::path& output,
                      const StageRange& range);

}  // namespace jade::import
