// SPDX-License-Identifier: Apache-2.0
#include "jade/import/capture.h"

#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/data/evdeblur_writer.h"
#include "jade/data/masks.h"
#include "jade/events/event_files.h"
#include "jade/imaging/image_io.h"
#include "jade/io/npy.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::string file_of(size_t index) {
  std::string name = std::to_string(index);
  return std::string(name.size() < 5 ? 5 - name.size() : 0, '0') + name + ".png";
}

Json json_of(const geometry::Intrinsics& c) {
  return {{"fx", c.fx}, {"fy", c.fy},       {"cx", c.cx},
          {"cy", c.cy}, {"width", c.width}, {"height", c.height}};
}

geometry::Intrinsics camera_from(const Json& json) {
  return {json.at("fx"), json.at("fy"),    json.at("cx"),
          json.at("cy"), json.at("width"), json.at("height")};
}

}  // namespace

data::Exposure exposure_of(const Shot& shot, const Capture& capture) {
  data::Exposure exposure;
  exposure.name = shot.name;
  exposure.blurry = shot.image;
  exposure.t_start_us = shot.t_start_us;
  exposure.t_end_us = shot.t_end_us;
  exposure.gain = shot.gain;
  exposure.events = capture.events.slice(shot.t_start_us, shot.t_end_us);
  exposure.camera = capture.camera.value_or(
      geometry::Intrinsics::centred(double(capture.width()), capture.width(), capture.height()));
  return exposure;
}

std::vector<data::Exposure> exposures_of(const Capture& capture) {
  std::vector<data::Exposure> exposures;
  for (const Shot& shot : capture.shots) {
    if (shot.duration_us() > 0) exposures.push_back(exposure_of(shot, capture));
  }
  return exposures;
}

void keep_capture(const fs::path& folder, const Capture& capture) {
  make_writable_folder(folder / "frames");
  Json frames = Json::array();
  for (size_t i = 0; i < capture.shots.size(); ++i) {
    throw_if_interrupted();
    const Shot& shot = capture.shots[i];
    imaging::write_image(folder / "frames" / file_of(i), shot.image, {16, 95});
    frames.push_back({{"name", shot.name},
                      {"file", file_of(i)},
                      {"start_us", shot.t_start_us},
                      {"end_us", shot.t_end_us},
                      {"blur_px", shot.blur_px},
                      {"gain", shot.gain},
                      {"masked", shot.mask.defined()}});
    if (shot.mask.defined())
      imaging::write_image(folder / "masks" / file_of(i), shot.mask.to(torch::kFloat32));
  }
  data::write_event_file(folder / "events.h5", capture.events, 1);
  if (capture.event_map.defined()) io::write_npy(folder / "event_map.npy", capture.event_map);
  if (capture.mask.defined()) {
    imaging::write_image(folder / data::kMaskFile, capture.mask.to(torch::kFloat32));
  }
  const Json all{{"source", capture.source},
                 {"format", capture.format},
                 {"sensor_height", capture.sensor.height},
                 {"sensor_width", capture.sensor.width},
                 {"sensor_is_said", capture.sensor_is_said},
                 {"filter", word_of(capture.filter)},
                 {"camera", capture.camera ? json_of(*capture.camera) : Json(nullptr)},
                 {"frames", frames}};
  // File names are arbitrary bytes, those in JSON are UTF-8.
  const std::string text = all.dump(1, ' ', false, Json::error_handler_t::replace);
  write_file(folder / "capture.json", text + "\n");
}

Capture load_capture(const fs::path& folder) {
  const fs::path file = folder / "capture.json";
  Capture capture;
  try {
    const Json all = Json::parse(read_file(file));
    capture.source = all.at("source");
    capture.format = all.at("format");
    capture.sensor = {all.at("sensor_height"), all.at("sensor_width")};
    capture.sensor_is_said = all.value("sensor_is_said", true);
    capture.filter =
        value_of<ColorFilter>(all.at("filter").get<std::string>()).value_or(ColorFilter::kNone);
    if (!all.at("camera").is_null()) capture.camera = camera_from(all.at("camera"));
    for (const Json& frame : all.at("frames")) {
      capture.shots.push_back(
          {frame.at("name"), imaging::read_image(folder / "frames" / std::string(frame.at("file"))),
           frame.at("start_us"), frame.at("end_us"), frame.at("blur_px"),
           frame.value("gain", 1.0)});
      if (frame.value("masked", false)) {
        capture.shots.back().mask =
            imaging::read_mask(folder / "masks" / std::string(frame.at("file")));
      }
    }
  } catch (const Json::exception& error) {
    throw DataError(concat(file.string(), ": expected what this program wrote, found ",
                           error.what(), "; remove the folder and import again"));
  }
  if (fs::exists(folder / "event_map.npy")) {
    capture.event_map = io::read_npy(folder / "event_map.npy");
  }
  if (fs::exists(folder / data::kMaskFile)) {
    capture.mask = imaging::read_mask(folder / data::kMaskFile);
  }
  events::EventFileOptions options;
  options.time_unit = events::TimeUnit::kUs;
  capture.events = events::read_events(folder / "events.h5", options).events;
  return capture;
}

}  // namespace jade::import
