// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "jade/data/evdeblur_writer.h"
#include "jade/simulate/footage.h"
#include "jade/simulate/options.h"
#include "jade/simulate/written_poses.h"

namespace jade::simulate {

/// A simulated recording and what is worth telling about it.
struct SimulateResult {
  data::EvDeblurContent content;
  /// The test views as the camera records them, by the names of content.test: those have nothing
  /// of object, flicker, optics and sensor.
  std::vector<data::SharpView> recorded_views;
  int64_t frames = 0;          ///< looked at by the sensors
  double blur_px = 0;          ///< mean blur of the exposures; 0: not known
  double largest_flow_px = 0;  ///< of a pixel between two of these frames; 0: not known
  PoseErrors pose_errors;      ///< of the written poses of the exposures
  /// Camera of content.events; absent if it is the camera of the frames.
  std::optional<EventCamera> event_camera;
};

/// Runs a simulation. Shows progress; the same options and seed give the same result for any number
/// of threads.
/// @throws ConfigError, DataError for a source that cannot be read, Interrupted.
SimulateResult simulate(const SimulateRun& run);

/// Simulates with given footage.
SimulateResult simulate(const SimulateRun& run, Footage& footage);

/// Sharp, noiseless frames at equal steps of every exposure, from its start to its end, for
/// training restorers (scripts/efnet/train_efnet.py --footage). No sensor looks on.
/// @param frames  of each exposure, at least 2
/// @return [exposures,frames,3,H,W] uint8
/// @throws as simulate().
torch::Tensor exposure_footage(const SimulateRun& run, int64_t frames);

/// Writes the data set in the EvDeblur layout with simulation.yaml beside it. Events of another
/// camera than that of the frames are left out, as data sets have one for both.
/// @throws DataError.
void write(const SimulateResult& result, const SimulateRun& run,
           const std::filesystem::path& folder);

/// Writes what a user's camera would have: a recording in the RPG text layout (recording/
/// rpg_writer.h) with its calibration, of two cameras in Kalibr's format, and nothing about poses.
/// Its frames are the exposures and those test views that were taken between them, with an exposure
/// of 1 µs; without recording.exposure_times the exposures alone, by their middles. truth/ gets the
/// data set of write(), for checks only; frames have the same names there, and with auto-exposure
/// gains.csv says how much brighter each frame of the recording is than its scene.
/// @throws DataError.
void write_recording(const SimulateResult& result, const SimulateRun& run,
                     const std::filesystem::path& folder);

}  // namespace jade::simulate
