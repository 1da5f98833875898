// SPDX-License-Identifier: Apache-2.0
// Data that the stages pass on: frames, events, and knowledge of the camera and its sensor.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/events/event_stream.h"
#include "jade/geometry/camera.h"
#include "jade/import/color.h"

namespace jade::import {

/// One frame of the camera.
struct Shot {
  std::string name;
  torch::Tensor image;  ///< [3,H,W] RGB float32 in [0,1]
  int64_t t_start_us = 0, t_end_us = 0;
  double blur_px = -1;  ///< how far the scene moved during it, px; below 0: not known
  double gain = 1;      ///< its brightness is that of the scene times this
  /// [1,H,W] bool, true: the pixel counts if Capture::mask agrees; undefined: all do.
  torch::Tensor mask = {};

  int64_t duration_us() const { return t_end_us - t_start_us; }
  int64_t t_mid_us() const { return t_start_us + duration_us() / 2; }
};

struct Capture {
  std::string source, format;  ///< the file or folder, and what it is, in words
  std::vector<Shot> shots;     ///< by time
  events::EventStream events;  ///< on the pixels and the clock of the shots, once these are settled
  events::ImageSize sensor;    ///< of the events, before they were undistorted
  bool sensor_is_said = true;  ///< by the recording; false: taken for that of the frames
  ColorFilter filter = ColorFilter::kNone;  ///< before the pixels of that sensor
  /// [2,h,w] float32: column and row where the events of its pixels went; undefined where they are.
  torch::Tensor event_map;
  /// [1,H,W] bool of all shots, true: the pixel counts; undefined: all count.
  torch::Tensor mask;
  /// A pinhole, centred, without distortion; absent where no calibration was given.
  std::optional<geometry::Intrinsics> camera;

  int64_t width() const { return shots.front().image.size(2); }
  int64_t height() const { return shots.front().image.size(1); }
};

/// The shots with a length as exposures with their events, without poses.
std::vector<data::Exposure> exposures_of(const Capture& capture);
data::Exposure exposure_of(const Shot& shot, const Capture& capture);

/// Writes frames/NNNN.png (16 bit), events.h5, capture.json and, where there are some, mask.png and
/// masks/NNNN.png into the folder, which is there.
/// @throws DataError.
void keep_capture(const std::filesystem::path& folder, const Capture& capture);

/// Reads what keep_capture wrote. @throws DataError naming the file.
Capture load_capture(const std::filesystem::path& folder);

}  // namespace jade::import
