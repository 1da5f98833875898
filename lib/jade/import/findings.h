// SPDX-License-Identifier: Apache-2.0
// Results of the stages "time" and "sensor", stored as JSON.
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

/// Offset of the clock of the events relative to that of the frames, and its source.
struct ClockFinding {
  double offset_ms = 0;
  std::string said;
  /// ClockOffset::curve from −reach to +reach of ClockOffsetOptions; empty if none was estimated.
  std::vector<double> curve;
};

/// Exposure time of the frames if the recording does not contain it, and its source.
struct ExposureFinding {
  int64_t length_us = 0;  ///< 0: the recording contains it
  recording::Stamp stamp = recording::Stamp::kMiddle;
  double error_us = 0;
  std::string said;
  std::vector<double> lengths_us, losses;  ///< as in ExposureLength
};

/// Whether no shot has an exposure time.
bool lacks_exposures(const Capture& capture);

/// Result of estimate_exposure_length().
/// @throws DataError if the user must give a length.
/// @param stamp  no value: tries start, middle and end
ExposureFinding find_exposures(const Capture& capture, std::optional<recording::Stamp> stamp);

/// Sets the exposures of the shots; does nothing if the recording contains them.
void set_exposures(const ExposureFinding& finding, Capture& capture);

/// The capture without the events of hot pixels.
Capture without_hot_pixels(const Capture& capture);

/// Transforms a capture so that frames and events share one view, if they do not yet.
using Align = std::function<void(Capture&)>;

/// The offset in the options, if given, else that of estimate_clock_offset(). An offset within two
/// milliseconds or three standard errors of 0 counts as 0. Warns of clocks at different rates.
/// Flipped events cause a warning (find_flip) and an offset of 0.
/// @param frames_apart  frames and events come from different files: a doubtful offset is then an
///   error; for a single recording it counts as 0, with a warning.
/// @throws DataError if the user must give an offset.
ClockFinding find_clock(const TimeOptions& options, const Capture& capture, bool frames_apart);

/// Properties of the event sensor, in raw pixels.
struct SensorFinding {
  std::vector<HotPixel> hot_pixels;  ///< pixels whose events are dropped
  events::Thresholds thresholds;
  ColorFilter filter = ColorFilter::kNone;  ///< colour filter on its pixels
  std::vector<double> blur_px;              ///< of each shot, as in Shot
  std::vector<double> gains;                ///< of each shot; empty if the camera's brightness is
                                            ///< constant
  std::string said;
};

/// Thresholds of the options if they are numbers; if the positive one is auto, the result of
/// data::estimate_thresholds(), or the default with a warning. If the frames are in colour and each
/// event pixel sees one channel, estimates thresholds in these channels. Warns of frames that are
/// raw mosaics.
/// @param align  for two cameras, applied before frames and events are compared and after hot
///   pixels are removed
SensorFinding find_sensor(const SensorOptions& options, const events::EventOptions& events,
                          const Capture& capture, const Align& align = {});

/// blur_px() of each shot. A shot that seems static but has half as many events as the upper
/// quarter of the shots counts as unknown: noise hides its motion. So does one without events in
/// half of its exposure or more.
std::vector<double> find_blur(const Capture& capture);

/// Removes the events of hot pixels, and sets the filter, the blur and the gains.
void clean(const SensorFinding& finding, Capture& capture);

void keep(const std::filesystem::path& folder, const ClockFinding& finding,
          const ExposureFinding& exposures = {});
void keep(const std::filesystem::path& folder, const SensorFinding& finding);

/// Reads the results that keep() wrote. @throws DataError naming the file.
ClockFinding load_clock(const std::filesystem::path& folder);
ExposureFinding load_exposures(const std::filesystem::path& folder);
SensorFinding load_sensor(const std::filesystem::path& folder);

}  // namespace jade::import
