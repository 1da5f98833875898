// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
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
  int64_t t_start_us = 0, t_end_us = 0;  ///< of the exposure; equal where its length is not known
  std::filesystem::path path = {};       ///< it was read from; temporary without mask_root
};

/// A calibration that lies beside a recording, as it was found.
struct CalibrationFile {
  std::string name;  ///< "calib.txt", "calibration.yaml", "camera_info.yaml"
  std::string text;
};

/// A camera's recording in its own clock and pixels: no poses, not undistorted.
struct Recording {
  std::filesystem::path source;
  std::string format;             ///< in words, "Prophesee EVT3"
  int64_t width = 0, height = 0;  ///< of the event sensor, 0: not known
  bool size_is_said = true;       ///< by the recording; false: taken from the frames, or not known
  events::EventStream events;     ///< none beside the sensor where its size is known
  int64_t stored_events = 0;      ///< kept or not
  events::TimeWindow stored_us;   ///< from the first of these to the last
  std::vector<Frame> frames;      ///< in order of time, of one size
  int64_t untimed_frames = 0;     ///< that are not among them, as nothing says when they were taken
  /// Which instant of the exposure a frame's single time marks, if its length is unknown.
  Stamp stamp = Stamp::kMiddle;
  Triggers triggers;
  /// Folder beside whose frames masks/ and mask.png may lie; empty: frames are temporary files.
  std::filesystem::path mask_root;
  std::shared_ptr<const void> keep;  ///< removes mask_root with its last owner, if it is temporary
  std::optional<CalibrationFile> calibration;
  std::vector<std::string> notes;  ///< what a user should know, a line each
};

struct ReadOptions {
  events::TimeUnit time_unit = events::TimeUnit::kAuto;  ///< of files that do not say it
  /// Span to keep, in the recording's clock: events in it and frames exposed wholly in it.
  std::optional<events::TimeWindow> window;
  /// Span to keep, in time since the first frame began.
  std::optional<events::TimeWindow> since_first_frame;
  /// If set and frames have times, only events within a quarter of a second, or two of the longest
  /// exposures, of a frame are kept. The value is how far the events' clock is ahead of the
  /// frames'. None: all events.
  std::optional<int64_t> near_frames_ahead_us;
  /// Keeps no more than the first so many events, for a look at a recording of any size;
  /// stored_events and stored_us tell of all. 0: all. Text and .npz are read whole all the same.
  int64_t most_events = 0;
  /// Which of several streams of events: the group or data set of an HDF5 file; empty: the one
  /// nearest to its root, the first by name.
  std::string events_group;
  /// Topic of the event stream in a ROS bag; empty: the first by name. Frames come from the same
  /// namespace if it has any.
  std::string topic;
  /// Topic of the frames in a ROS bag; empty: pictures before depth, then the first by name.
  std::string frames_topic;
  /// Bytes that a kept event will cost the caller at most; a recording whose events would not fit
  /// into 0.7 of this machine's memory is refused before they are read.
  double event_bytes = 17;
  /// A folder of images or a video that holds the frames instead of the recording's own.
  std::filesystem::path frames;
  std::filesystem::path frame_times;  ///< a list of exposures (exposures.h) for the frames
  double exposure_ms = 0;             ///< of frames whose own length is not known; 0: not known
  std::optional<Stamp> stamp;         ///< of a frame's only time; none: as the format has it
  TriggerLevel trigger_level = TriggerLevel::kHigh;
  /// Runs scripts/read_recording.py; empty: $JADE_PYTHON, else the project's own, else python3.
  std::filesystem::path python;
};

/// Reads a recording of any format that docs/import.md lists, recognised by its content.
/// Exposures come from options.frame_times, else from the recording's own fields, else from trigger
/// edges where there are as many as frames, else from options.exposure_ms; each other case is a
/// note. Takes 17 bytes per event that is kept and 12 per pixel of every frame; of Prophesee's and
/// HDF5 files no more than that is held while they are read, of others all events are.
/// Missing frames and missing events are notes, no errors.
/// @throws DataError naming the path, one line: missing, empty, truncated or foreign files, frames
///   of different sizes, times that do not fit, what does not fit into memory, and packages that
///   scripts/setup.sh --import has not installed. @throws Interrupted.
Recording read_recording(const std::filesystem::path& path, const ReadOptions& options = {});

}  // namespace jade::recording
