// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "jade/data/evdeblur_writer.h"
#include "jade/simulate/footage.h"
#include "jade/simulate/options.h"
#include "jade/simulate/written_poses.h"

namespace jade::simulate {

/// A simulated recording and statistics about it.
struct SimulateResult {
  data::EvDeblurContent content;
  /// The test views with object, flicker, optics and sensor effects, by the names of content.test,
  /// which are without.
  std::vector<data::SharpView> recorded_views;
  int64_t frames = 0;          ///< number of frames sampled by the sensors
  double blur_px = 0;          ///< mean blur of the exposures; 0: unknown
  double largest_flow_px = 0;  ///< of a pixel between two of these frames; 0: unknown
  PoseErrors pose_errors;      ///< of the written poses of the exposures
  /// Camera of content.events; no value if it is the camera of the frames.
  std::optional<EventCamera> event_camera;
};

/// Runs a simulation. Shows progress; the same options and seed give the same result for any number
/// of threads.
/// @throws ConfigError, DataError for a source that cannot be read, Interrupted.
SimulateResult simulate(const SimulateRun& run);

/// Simulates with given footage.
SimulateResult simulate(const SimulateRun& run, Footage& footage);

/// Sharp, noiseless frames at equal steps of every exposure, from its start to its end, for
/// training restorers (scripts/efnet/train_efnet.py --footage). Applies no sensor effects.
/// @param frames  of each exposure, at least 2
/// @return [exposures,frames,3,H,W] uint8
/// @throws as simulate().
torch::Tensor exposure_footage(const SimulateRun& run, int64_t frames);

/// Writes the data set in the EvDeblur layout with simulation.yaml beside it. Omits events of a
/// separate camera, because data sets have one camera for both.
/// @throws DataError.
void write(const SimulateResult& result, const SimulateRun& run,
           const std::filesystem::path& folder);

/// Writes the files of a real camera: a recording in the RPG text layout (recording/ rpg_writer.h)
/// with its calibration, for two cameras in Kalibr's format, without poses. Its frames are the
/// exposures and the test views between them, with an exposure of 1 µs; without
/// recording.exposure_times only the exposures, with their middles as times. truth/ contains the
/// data set of write(), for checks only; its frames have the same names, and with auto-exposure
/// gains.csv contains the brightness of each recorded frame relative to the scene.
/// @throws DataError.
void write_recording(const SimulateResult& result, const SimulateRun& run,
                     const std::filesystem::path& folder);

}  // namespace jade::simulate
