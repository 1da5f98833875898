// SPDX-License-Identifier: Apache-2.0
// Results of the stages "time" and "sensor", kept as JSON.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "jade/events/thresholds.h"
#include "jade/import/capture.h"
#include "jade/import/color.h"
#include "jade/import/hot_pixels.h"
#include "jade/import/options.h"
#include "jade/recording/exposures.h"

namespace jade::import {

/// How far the clock of the events is ahead of that of the frames, and how that is known.
struct ClockFinding {
  double offset_ms = 0;
  std::string said;
  /// ClockOffset::curve from −reach to +reach of ClockOffsetOptions; empty where none was sought.
  std::vector<double> curve;
};

/// How long frames were exposed where the recording does not say it, and how that is known.
struct ExposureFinding {
  int64_t length_us = 0;  ///< 0: the recording says it
  recording::Stamp stamp = recording::Stamp::kMiddle;
  double error_us = 0;
  std::string said;
  std::vector<double> lengths_us, losses;  ///< as in ExposureLength
};

/// Whether no shot has a length.
bool lacks_exposures(const Capture& capture);

/// Result of estimate_exposure_length(). @throws DataError if a length must be given.
/// @param stamp  absent: start, middle and end are tried
ExposureFinding find_exposures(const Capture& capture, std::optional<recording::Stamp> stamp);

/// Gives shots their exposures; nothing where the recording says them.
void set_exposures(const ExposureFinding& finding, Capture& capture);

/// The capture without the events of pixels that fire by themselves.
Capture without_hot_pixels(const Capture& capture);

/// Brings a capture to where frames and events see the same, if that is elsewhere.
using Align = std::function<void(Capture&)>;

/// The offset of the options where they give one, else that which estimate_clock_offset() finds.
/// One that is within two milliseconds or three of its standard errors of 0 counts as 0.
/// Events that lie mirrored against the frames are a warning (find_mirroring), and the offset is 0.
/// @param frames_apart  frames and events come from different files: an offset in doubt is an error
///   then, and counts as 0, said so, where both are of one recording.
/// @throws DataError where an offset must be given.
ClockFinding find_clock(const TimeOptions& options, const Capture& capture, bool frames_apart);

/// The sensor of the events, on its raw pixels.
struct SensorFinding {
  std::vector<HotPixel> hot_pixels;  ///< whose events are to go
  events::Thresholds thresholds;
  ColorFilter filter = ColorFilter::kNone;  ///< before its pixels
  std::vector<double> blur_px;              ///< of each shot, as in Shot
  std::vector<double> gains;                ///< the same; none where the camera kept one
  std::string said;
};

/// Thresholds of the options where they are numbers; where the positive one is auto, those that
/// data::estimate_thresholds() finds, else the default, with a warning. Where the frames are in
/// colour and the events follow one channel each, thresholds are found in these channels. Frames
/// that are raw mosaics get a warning.
/// @param align  of two cameras, before frames and events are compared; hot pixels come before it
SensorFinding find_sensor(const SensorOptions& options, const events::EventOptions& events,
                          const Capture& capture, const Align& align = {});

/// blur_px() of each shot. One that seems still though it has half as many events as the upper
/// quarter of the shots is not known: its motion drowns in noise.
std::vector<double> find_blur(const Capture& capture);

/// Takes the events of the hot pixels out, sets the filter, the blur and the gains.
void clean(const SensorFinding& finding, Capture& capture);

void keep(const std::filesystem::path& folder, const ClockFinding& finding,
          const ExposureFinding& exposures = {});
void keep(const std::filesystem::path& folder, const SensorFinding& finding);

/// Reads the results that keep() wrote. @throws DataError naming the file.
ClockFinding load_clock(const std::filesystem::path& folder);
ExposureFinding load_exposures(const std::filesystem::path& folder);
SensorFinding load_sensor(const std::filesystem::path& folder);

}  // namespace jade::import
