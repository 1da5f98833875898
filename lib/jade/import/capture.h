// SPDX-License-Identifier: Apache-2.0
// Data passed between the stages: frames, events, and knowledge of the camera and its sensor.
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
  double blur_px = -1;  ///< motion of the scene during the exposure, px; negative: unknown
  double gain = 1;      ///< frame brightness = scene brightness · gain
  /// [1,H,W] bool, true: the pixel counts if Capture::mask agrees; undefined: all pixels count.
  torch::Tensor mask = {};

  int64_t duration_us() const { return t_end_us - t_start_us; }
  int64_t t_mid_us() const { return t_start_us + duration_us() / 2; }
};

struct Capture {
  std::string source, format;  ///< the file or folder, and its format, in words
  std::vector<Shot> shots;     ///< sorted by time
  events::EventStream events;  ///< in the pixels and the clock of the shots, once these are known
  events::ImageSize sensor;    ///< size of the event sensor, before undistortion
  bool sensor_is_said = true;  ///< from the recording; false: assumed equal to the frames' size
  ColorFilter filter = ColorFilter::kNone;  ///< colour filter on that sensor's pixels
  /// [2,h,w] float32: column and row to which events of each raw pixel moved; undefined: unmoved.
  torch::Tensor event_map;
  /// [1,H,W] bool for all shots, true: the pixel counts; undefined: all pixels count.
  torch::Tensor mask;
  /// A pinhole, centred, without distortion; no value without a calibration.
  std::optional<geometry::Intrinsics> camera;

  int64_t width() const { return shots.front().image.size(2); }
  int64_t height() const { return shots.front().image.size(1); }
};

/// The shots of non-zero length as exposures with their events, without poses.
std::vector<data::Exposure> exposures_of(const Capture& capture);
data::Exposure exposure_of(const Shot& shot, const Capture& capture);

/// Writes frames/NNNN.png (16 bit), events.h5, capture.json and, if there are masks, mask.png and
/// masks/NNNN.png into the existing folder.
/// @throws DataError.
void keep_capture(const std::filesystem::path& folder, const Capture& capture);

/// Reads the files that keep_capture wrote. @throws DataError naming the file.
Capture load_capture(const std::filesystem::path& folder);

}  // namespace jade::import
