// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>

#include "jade/data/evdeblur_writer.h"
#include "jade/simulate/camera_path.h"
#include "jade/simulate/frame_source.h"
#include "jade/simulate/options.h"

namespace jade::simulate {

/// A simulated recording and what is worth telling about it.
struct SimulateResult {
  data::EvDeblurContent content;
  int64_t frames = 0;          ///< rendered for the events and the blur
  double blur_px = 0;          ///< mean blur of the exposures
  double largest_flow_px = 0;  ///< between two of these frames
};

/// Runs a simulation. Shows progress; the same options and seed give the same result for any number
/// of threads.
/// @throws ConfigError, DataError for a source that cannot be read, Interrupted.
SimulateResult simulate(const SimulateRun& run);

/// The same with a source and a rig at hand.
SimulateResult simulate(const SimulateRun& run, const FrameSource& source, const CameraRig& rig);

/// Writes the data set in the EvDeblur layout with simulation.yaml beside it.
/// @throws DataError.
void write(const SimulateResult& result, const SimulateRun& run,
           const std::filesystem::path& folder);

}  // namespace jade::simulate
