// SPDX-License-Identifier: Apache-2.0
// Writes the data set that an import produces, and the scene.yaml that trains it.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "jade/import/capture.h"
#include "jade/import/options.h"
#include "jade/import/structure_from_motion.h"

namespace jade::import {

/// Role of a shot in the data set.
enum class Part { kTrain, kHeldOut, kTest, kLeftOut };

/// Assigns roles. Test frames are the named ones, else sharp ones (at most a quarter of all if they
/// have a length), else every n-th exposure is held out. Shots without a pose in
/// `found` are omitted; named frames that are blurry are held out.
/// @throws ConfigError as check_test_names(), DataError if no training frame remains.
std::vector<Part> parts_of(const Capture& capture, const std::vector<TimedPose>& found,
                           const TestOptions& options);

/// @throws ConfigError for a name of a test frame that no shot has.
void check_test_names(const Capture& capture, const TestOptions& options);

/// Writes the data set in the EvDeblur layout into `folder`, with frames.csv (the shot of each
/// frame), the masks of the capture and its shots, and scene.yaml.
/// @return a one-line description
std::string write_scene(const std::filesystem::path& folder, const Capture& capture,
                        const Reconstruction& found, const ImportOptions& options);

}  // namespace jade::import
