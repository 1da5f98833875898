// SPDX-License-Identifier: Apache-2.0
// Reads a recording as a Capture, and checks what only the recording can show.
#pragma once

#include <filesystem>
#include <optional>
#include <torch/types.h>

#include "jade/import/capture.h"
#include "jade/import/options.h"
#include "jade/recording/exposures.h"

namespace jade::import {

/// Frames that an import needs: three are too few for a scene, and structure from motion cannot
/// check itself.
constexpr size_t kFewestFrames = 4;

/// The stamp that the options name; no value for auto.
std::optional<recording::Stamp> stamp_of(const TimeOptions& options);

/// Reads frames, events and masks of a recording, leaves out bad frames and copied events with a
/// warning, and copies a calibration found beside the recording into the existing folder.
/// @throws DataError for input that cannot be read or ordered; ConfigError for options that do not
///   fit the recording.
Capture read_capture(const ImportOptions& options, const std::filesystem::path& folder);

/// The calibration that read_capture copied; empty if there is none.
std::filesystem::path kept_calibration(const std::filesystem::path& folder);

/// Checks that events and frames share one pixel grid, as they must without a calibration of two
/// cameras. If no file has the size of the event sensor, its events must lie on the frames.
/// @throws DataError naming both sizes.
void check_one_sensor(const Capture& capture);

/// The mask of all frames from a file; undefined for an empty path. @throws DataError.
torch::Tensor read_mask(const std::filesystem::path& path, const Capture& capture);

/// Drops the events of excluded pixels if frames and events share their pixels, so that exposures,
/// clock, thresholds and COLMAP's images do not depend on them.
void drop_masked_events(Capture& capture);

}  // namespace jade::import
