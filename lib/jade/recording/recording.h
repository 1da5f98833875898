// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/events/event_files.h"
#include "jade/events/event_stream.h"
#include "jade/recording/exposures.h"

namespace jade::recording {

/// A picture that the camera took.
struct Frame {
  std::string name;                      ///< without folder and extension
  torch::Tensor image;                   ///< [3,H,W] RGB float32 in [0,1], CPU
  int64_t t_start_us = 0, t_end_us = 0;  ///< of the exposure; equal where its length is not known
};

/// A calibration that lies beside a recording, as it was found.
struct CalibrationFile {
  std::string name;  ///< "calib.txt", "calibration.yaml"
  std::string text;
};

/// What a camera wrote, in its own clock and pixels: no poses, nothing undistorted.
struct Recording {
  std::filesystem::path source;
  std::string format;             ///< in words, "Prophesee EVT3"
  int64_t width = 0, height = 0;  ///< of the event sensor, 0: not known
  events::EventStream events;     ///< none beside the sensor where its size is known
  std::vector<Frame> frames;      ///< in order of time, of one size
  /// What the one time of a frame is, where the length of its exposure is not known.
  Stamp stamp = Stamp::kMiddle;
  Triggers triggers;
  std::optional<CalibrationFile> calibration;
  std::vector<std::string> notes;  ///< what a user should know, a line each
};

struct ReadOptions {
  events::TimeUnit time_unit = events::TimeUnit::kAuto;  ///< of files that do not say it
  /// What to keep, in the recording's clock: events in it and frames exposed wholly in it.
  std::optional<events::TimeWindow> window;
  /// A folder of images or a video that holds the frames instead of the recording's own.
  std::filesystem::path frames;
  std::filesystem::path frame_times;  ///< a list of exposures (exposures.h) for the frames
  double exposure_ms = 0;             ///< of frames whose own length is not known; 0: not known
  std::optional<Stamp> stamp;         ///< of a frame's only time; none: as the format has it
  TriggerLevel trigger_level = TriggerLevel::kHigh;
  /// Runs scripts/read_recording.py; empty: $JADE_PYTHON, else the project's own, else python3.
  std::filesystem::path python;
};

/// Reads a recording of any format that docs/own-recording.md lists, recognised by its content.
/// Exposures come from options.frame_times, else from the recording's own fields, else from trigger
/// edges where there are as many as frames, else from options.exposure_ms; each other case is a
/// note. Takes 17 bytes per event and 12 per pixel of every frame; options.window bounds both.
/// Missing frames and missing events are notes, no errors.
/// @throws DataError naming the path, one line: missing, empty, truncated or foreign files, frames
///   of different sizes, times that do not fit, what does not fit into memory, and packages that
///   scripts/setup.sh --import has not installed. @throws Interrupted.
Recording read_recording(const std::filesystem::path& path, const ReadOptions& options = {});

}  // namespace jade::recording
