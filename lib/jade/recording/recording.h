// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
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
  int64_t t_start_us = 0, t_end_us = 0;  ///< of the exposure; equal if its length is unknown
  std::filesystem::path path = {};       ///< source file; temporary if mask_root is empty
};

/// A calibration file found beside a recording.
struct CalibrationFile {
  std::string name;  ///< "calib.txt", "calibration.yaml", "camera_info.yaml"
  std::string text;
};

/// A camera's recording by its own clock and in raw pixels: no poses, not undistorted.
struct Recording {
  std::filesystem::path source;
  std::string format;             ///< in words, "Prophesee EVT3"
  int64_t width = 0, height = 0;  ///< of the event sensor, 0: unknown
  bool size_is_said = true;       ///< from the recording; false: inferred from the frames, or
                                  ///< unknown
  events::EventStream events;     ///< none outside the sensor if its size is known
  int64_t stored_events = 0;      ///< number of events in the file, kept or not
  events::TimeWindow stored_us;   ///< from the first stored event to the last
  std::vector<Frame> frames;      ///< sorted by time, all of one size
  int64_t untimed_frames = 0;     ///< frames that were skipped because their time is unknown
  /// Which instant of the exposure a frame's single time marks, if its length is unknown.
  Stamp stamp = Stamp::kMiddle;
  Triggers triggers;
  std::map<int64_t, Triggers> other_triggers;  ///< by channel, those that `triggers` leaves out
  /// Folder whose frames may have masks/ and mask.png beside them; empty: frames are temporary
  /// files.
  std::filesystem::path mask_root;
  std::shared_ptr<const void> keep;  ///< removes mask_root with its last owner, if it is temporary
  /// The first that can be read counts.
  std::vector<CalibrationFile> calibrations;
  std::vector<std::string> notes;     ///< information for the user, one line each
  std::vector<std::string> warnings;  ///< faults of the recording, repaired or left out
};

struct ReadOptions {
  events::TimeUnit time_unit = events::TimeUnit::kAuto;  ///< for files that do not specify it
  /// Time span to keep, by the recording's clock: events in it and frames exposed entirely in it.
  std::optional<events::TimeWindow> window;
  /// Time span to keep, relative to the start of the first frame.
  std::optional<events::TimeWindow> since_first_frame;
  /// If set and frames have times, keeps only events within a quarter of a second, or two of the
  /// longest exposures, of a frame. The value is the offset of the events' clock relative to the
  /// frames'. No value: all events.
  std::optional<int64_t> near_frames_ahead_us;
  /// Keeps at most the first `most_events` events, for a quick look at a large recording;
  /// stored_events and stored_us count all. 0: all. Text and .npz are read entirely in any case.
  int64_t most_events = 0;
  /// Which of several event streams: the group or data set of an HDF5 file; empty: the one nearest
  /// to its root, the first by name.
  std::string events_group;
  /// Topic of the event stream in a ROS bag; empty: the first by name. Frames come from the same
  /// namespace if it has any.
  std::string topic;
  /// Topic of the frames in a ROS bag; empty: pictures before depth, then the first by name.
  std::string frames_topic;
  /// Peak bytes per kept event in the caller; a recording whose events need more than 0.7 of this
  /// machine's memory is rejected before it is read.
  double event_bytes = 17;
  /// A folder of images, a TIFF of pages or a video that replaces the recording's frames.
  std::filesystem::path frames;
  /// A list of exposures (exposures.h) for the frames, or of numbers in their order.
  std::filesystem::path frame_times;
  double exposure_ms = 0;      ///< for frames of unknown length; 0: unknown
  std::optional<Stamp> stamp;  ///< instant that a frame's single time marks; no value: the
                               ///< format's default
  TriggerLevel trigger_level = TriggerLevel::kHigh;
  /// Interpreter of scripts/read_recording.py; empty: $JADE_PYTHON, else the project's own, else
  /// python3.
  std::filesystem::path python;
};

/// Reads a recording of any format in docs/import.md, recognised by its content. Exposures come
/// from options.frame_times, else from the recording's own fields, else from trigger edges if their
/// number equals that of the frames, else from options.exposure_ms; each other case is a note.
/// Needs 17 bytes per kept event and 12 per pixel of every frame; Prophesee's and HDF5 files are
/// streamed, others are loaded entirely. Missing frames and missing events are notes, not errors.
/// @throws DataError naming the path, one line: missing, empty, truncated or unsupported files,
///   frames of different sizes, inconsistent times, too little memory, and packages that
///   scripts/setup.sh --import has not installed.
/// @throws Interrupted.
Recording read_recording(const std::filesystem::path& path, const ReadOptions& options = {});

/// The lists outside ReadOptions::frames that may have the times of its images: those in the
/// folders above it, and beside a file.
std::vector<std::filesystem::path> lists_beside(const std::filesystem::path& frames);

}  // namespace jade::recording
