// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/options.h"

#include <algorithm>

#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/world/worlds.h"

namespace jade::simulate {

SimulateOptions preset_options(Preset preset) {
  SimulateOptions o;
  o.preset = preset;
  if (preset == Preset::kCdavis) {
    o.image.full_well = 8000;
    o.image.read_noise = 0.004;
    o.events.threshold_positive = o.events.threshold_negative = 0.25;
    o.events.threshold_spread = 0.03;
    o.events.refractory_us = 100;
    o.events.cutoff_hz = 1000;
    o.events.leak_hz = 0.1;
    o.events.shot_hz = 1;
    o.events.hot_fraction = 1e-4;
    o.events.hot_hz = 50;
  } else {
    o.width = 600, o.height = 400, o.focal_px = 600;
    o.exposures = 29, o.exposure_ms = 40, o.gap_ms = 5;
    o.motion.blur_px = 20;
    o.sampling.min_fps = 1000;
    o.image.encoding = Encoding::kSrgb;
  }
  return o;
}

void validate(const SimulateRun& run) {
  const SimulateOptions& o = run.simulate;
  const auto names = world::world_names();
  if (o.source == Source::kWorld && std::find(names.begin(), names.end(), o.world) == names.end()) {
    throw ConfigError(concat("simulate.world: expected one of ", listing(names, names.size()),
                             "; found '", o.world, "'"));
  }
  if (o.source != Source::kWorld && o.path.empty()) {
    throw ConfigError(concat("simulate.path: source '", word_of(o.source),
                             "' needs a file or folder, found nothing; set simulate.path"));
  }
  for (const auto* vector :
       {&o.camera.eye, &o.camera.target, &o.camera.up, &o.camera.eye_reach, &o.camera.target_reach,
        &o.event_camera.centre, &o.event_camera.turn_deg}) {
    if (!vector->empty() && vector->size() != 3) {
      throw ConfigError(
          concat("simulate.camera, simulate.event_camera: expected vectors of 3 numbers, found ",
                 vector->size()));
    }
  }
  const EventCameraOptions& beside = o.event_camera;
  const int64_t event_width = beside.width > 0 ? beside.width : o.width;
  if (o.image.dead_columns >= o.width || o.events.dead_columns >= event_width) {
    throw ConfigError(concat(
        "simulate.image.dead_columns, simulate.events.dead_columns: expected fewer than the ",
        o.width, " and ", event_width, " columns of the sensors, found ", o.image.dead_columns,
        " and ", o.events.dead_columns));
  }
  const bool described =
      !beside.turn_deg.empty() || beside.width != 0 || beside.height != 0 || beside.focal_px != 0;
  if (described && !beside.is_beside()) {
    throw ConfigError(
        "simulate.event_camera: expected its centre [x, y, z] beside the camera of the frames, "
        "found none; set simulate.event_camera.centre");
  }
  if (beside.is_beside() && o.source == Source::kFrames) {
    throw ConfigError(
        "simulate.event_camera: expected source world or ply, found stored frames, which no second "
        "camera has seen");
  }
  if (o.seen_test_views > std::min(o.test_views, o.exposures)) {
    throw ConfigError(concat("simulate.seen_test_views: at most test_views (", o.test_views,
                             ") and exposures (", o.exposures, "), found ", o.seen_test_views));
  }
  if (o.test_views > o.seen_test_views && o.exposures > 1 && o.gap_ms <= 0) {
    throw ConfigError(
        "simulate.gap_ms: test views between exposures need a gap, found 0; raise gap_ms or "
        "seen_test_views");
  }
}

}  // namespace jade::simulate
