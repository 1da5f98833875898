// SPDX-License-Identifier: Apache-2.0
// The data set that an import ends with, and the scene.yaml that trains it.
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

/// Named frames, else sharp ones, at most a quarter of all where they have a length, else every so
/// many exposures held out. Shots without a pose in
/// `found` are left out; named ones that are blurry are held out.
/// @throws ConfigError as check_test_names(), DataError where nothing is left for training.
std::vector<Part> parts_of(const Capture& capture, const std::vector<TimedPose>& found,
                           const TestOptions& options);

/// @throws ConfigError for a name of a test frame that no shot has.
void check_test_names(const Capture& capture, const TestOptions& options);

/// Writes the data set in the EvDeblur layout into `folder`, with frames.csv (which frame is which
/// shot), the masks of the capture and its shots, and scene.yaml. @return one line that says what
/// it is
std::string write_scene(const std::filesystem::path& folder, const Capture& capture,
                        const Reconstruction& found, const ImportOptions& options);

}  // namespace jade::import
