// SPDX-License-Identifier: Apache-2.0
#include "jade/import/importer.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <torch/types.h>

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/folder_lock.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/core/readable.h"
#include "jade/data/masks.h"
#include "jade/data/named_files.h"
#include "jade/import/capture.h"
#include "jade/import/colmap.h"
#include "jade/import/findings.h"
#include "jade/import/fingerprint.h"
#include "jade/import/latents.h"
#include "jade/import/read_capture.h"
#include "jade/import/scene_files.h"
#include "jade/import/structure_from_motion.h"
#include "jade/import/undistortion.h"
#include "jade/import/vignetting.h"
#include "jade/recording/recording.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;

/// The values of an options struct, one line each.
template <class Options>
std::string text_of(Options options) {
  std::string text;
  for (const auto& [key, value] : config::values(fields_of(options)))
    text += key + "=" + value + "\n";
  return text;
}

/// Number of events while the shutter was open.
int64_t events_in_exposures(const Capture& capture) {
  int64_t count = 0;
  for (const Shot& shot : capture.shots) {
    count += capture.events.slice(shot.t_start_us, shot.t_end_us).size();
  }
  return count;
}

void check_clocks(const Capture& capture) {
  if (events_in_exposures(capture) == 0) {
    throw DataError(concat(capture.source, ": no event lies in an exposure: frames from ",
                           capture.shots.front().t_start_us, " to ", capture.shots.back().t_end_us,
                           " us, events from ", capture.events.first_us(), " to ",
                           capture.events.last_us(),
                           " us; the two clocks do not overlap, give the offset between them with "
                           "--offset-ms"));
  }
}

/// Warns of exposures without events. Reading notes them if the recording has the exposures'
/// lengths.
void tell_pauses(const Capture& capture) {
  size_t without = 0;
  std::string first;
  for (const Shot& shot : capture.shots) {
    if (shot.duration_us() == 0) continue;
    if (!capture.events.slice(shot.t_start_us, shot.t_end_us).empty()) continue;
    if (without++ == 0) first = shot.name;
  }
  if (without == 0) return;
  log_warn(concat(without, " of ", capture.shots.size(), " exposures have no events (the first is ",
                  first, "); did the recording lose events, or the camera stand still?"));
}

/// Converts events to the clock of the frames.
void set_clock(double ahead_ms, Capture& capture) {
  const auto ahead_us = std::llround(1000 * ahead_ms);
  if (ahead_us == 0) return;
  const events::EventStream& e = capture.events;
  capture.events = events::EventStream(e.x(), e.y(), e.t_us() - ahead_us, e.polarity());
}

/// Results of the stages so far.
struct Progressed {
  Capture capture;
  std::optional<Calibration> calibration;
  fs::path latent_folder;
  std::vector<LatentImage> latents;
  Reconstruction found;
};

std::string said_of(const Capture& capture) {
  return concat(capture.format, ", ", capture.shots.size(), " frames of ", capture.width(), "x",
                capture.height(), ", ", grouped(capture.events.size()), " events");
}

std::string said_of(const SearchResult& result) {
  const Attempt& a = result.attempts[result.chosen];
  return concat(a.registered, " of ", a.images, " images, ", a.points, " points, error ",
                readable(a.error_px, 2), " px, ", said_of_blur(a), ", focal length ",
                readable(result.best.camera.fx, 4), " px, attempt ", a.name);
}

/// Names the masks beside the folder of --frames.
std::string masks_text(const fs::path& frames) {
  if (frames.empty()) return "";
  const fs::path whole = fs::absolute(frames).lexically_normal();
  const fs::path beside = (whole.has_filename() ? whole : whole.parent_path()).parent_path();
  return fingerprint(data::in_any_case(beside, "masks")) +
         fingerprint(data::in_any_case(beside, data::kMaskFile));
}

/// Names the lists of times that the frames of --frames may have outside them.
std::string lists_text(const fs::path& frames) {
  if (frames.empty()) return "";
  std::string all;
  for (const fs::path& list : recording::lists_beside(frames)) all += fingerprint(list);
  return all;
}

Stage read_stage(const ImportOptions& options, Progressed& so_far) {
  return {
      "read",
      concat(fingerprint(options.recording), fingerprint(options.frames),
             masks_text(options.frames), lists_text(options.frames),
             fingerprint(options.time.frame_times), text_of(options.time), options.events_group,
             "\n", options.topic, options.frames_topic.empty() ? "" : "\n" + options.frames_topic),
      [&](const fs::path& folder) {
        const Capture capture = read_capture(options, folder);
        keep_capture(folder, capture);
        return said_of(capture);
      },
      [&](const fs::path& folder) {
        so_far.capture = load_capture(folder);
        so_far.calibration = calibration_of(options.lens, kept_calibration(folder));
        if (!is_rig(so_far.calibration)) check_one_sensor(so_far.capture);
        if (so_far.calibration) settle_sensor(*so_far.calibration, so_far.capture);
        check_test_names(so_far.capture, options.test);
        so_far.capture.mask =
            data::both_masks(so_far.capture.mask, read_mask(options.lens.mask, so_far.capture));
        drop_masked_events(so_far.capture);
      }};
}

std::string mask_text(const ImportOptions& options) {
  return options.lens.mask.empty() ? "" : fingerprint(options.lens.mask);
}

/// Inputs of the stages time and sensor besides their own settings: the relation of two cameras,
/// and the masks.
std::string rig_text(const ImportOptions& options) {
  if (!(options.lens.plane_depth > 0)) return mask_text(options);
  return text_of(options.lens) + fingerprint(options.lens.calibration) + mask_text(options);
}

/// Aligns frames and events of two cameras; does nothing for one camera.
Align align_of(const ImportOptions& options, const Progressed& so_far) {
  if (!is_rig(so_far.calibration)) return {};
  return [&](Capture& capture) {
    undistort(options.lens, *so_far.calibration, capture);
    capture.sensor = {capture.height(), capture.width()};
  };
}

struct Times {
  ClockFinding clock;
  ExposureFinding exposures;
};

/// Estimates exposures if the recording has none, and the offset between the clocks.
Times find_times(const ImportOptions& options, const Progressed& so_far) {
  const bool apart = !options.frames.empty() || is_rig(so_far.calibration);
  Capture seen = so_far.capture;
  if (const Align align = align_of(options, so_far)) {
    seen = without_hot_pixels(seen);
    align(seen);
  }
  Times times;
  const Capture stamped = seen;
  const auto find_length = [&](double ahead_ms, std::optional<recording::Stamp> stamp) {
    seen = stamped;
    set_clock(ahead_ms, seen);
    times.exposures = find_exposures(seen, stamp);
    seen = stamped;
    set_exposures(times.exposures, seen);
  };
  const bool is_unknown = lacks_exposures(seen);
  if (is_unknown) find_length(options.time.offset_ms, stamp_of(options.time));
  times.clock = find_clock(options.time, seen, apart);
  // The length was estimated with the clocks unaligned; repeat it.
  if (is_unknown && times.clock.offset_ms != options.time.offset_ms)
    find_length(times.clock.offset_ms, times.exposures.stamp);
  return times;
}

/// Converts events to the clock of the frames, and sets the frames' exposures if the recording has
/// none.
Stage time_stage(const ImportOptions& options, Progressed& so_far) {
  return {"time", text_of(options.time) + rig_text(options),
          [&](const fs::path& folder) {
            const Times times = find_times(options, so_far);
            Capture moved = so_far.capture;
            set_exposures(times.exposures, moved);
            set_clock(times.clock.offset_ms, moved);
            check_clocks(moved);
            if (lacks_exposures(so_far.capture)) tell_pauses(moved);
            keep(folder, times.clock, times.exposures);
            return concat(times.exposures.said.empty() ? "" : times.exposures.said + ", ",
                          "events ahead by ", times.clock.offset_ms, " ms (", times.clock.said,
                          "), ", events_in_exposures(moved), " of ", moved.events.size(),
                          " within exposures");
          },
          [&](const fs::path& folder) {
            set_exposures(load_exposures(folder), so_far.capture);
            set_clock(load_clock(folder).offset_ms, so_far.capture);
          }};
}

/// Removes hot pixels and determines the thresholds, which later stages read.
Stage sensor_stage(ImportOptions& options, Progressed& so_far) {
  return {"sensor",
          concat(text_of(options.sensor),
                 options.events.threshold_positive.is_auto() ? "auto" : "given", " ",
                 double(options.events.threshold_positive), " ", options.events.threshold_negative),
          [&](const fs::path& folder) {
            const SensorFinding sensor = find_sensor(options.sensor, options.events, so_far.capture,
                                                     align_of(options, so_far));
            keep(folder, sensor);
            return sensor.said;
          },
          [&](const fs::path& folder) {
            const SensorFinding sensor = load_sensor(folder);
            clean(sensor, so_far.capture);
            options.events.threshold_positive = sensor.thresholds.positive;
            options.events.threshold_negative = sensor.thresholds.negative;
          }};
}

/// Undistorts frames and events to a centred pinhole; without a calibration, stores nothing.
Stage undistort_stage(const ImportOptions& options, Progressed& so_far) {
  return {"undistort",
          concat(text_of(options.lens), fingerprint(options.lens.calibration), mask_text(options)),
          [&](const fs::path& folder) -> std::string {
            if (!so_far.calibration) return "no calibration given";
            Capture capture = so_far.capture;
            const std::string said = undistort(options.lens, *so_far.calibration, capture);
            keep_capture(folder, capture);
            return said;
          },
          [&](const fs::path& folder) {
            if (!fs::exists(folder / "capture.json")) return;
            so_far.capture = {};  // frees the old capture first, so that memory holds only one
            so_far.capture = load_capture(folder);
          }};
}

Stage restore_stage(const ImportOptions& options, Progressed& so_far) {
  return {"restore",
          concat(text_of(options.events), text_of(options.latents),
                 options.latents.kind == LatentKind::kEdi
                     ? ""
                     : restore::restorer_file_sha256(options.efnet),
                 " ", options.test.sharp_px),
          [&](const fs::path& folder) {
            return concat(write_latents(folder, so_far.capture, options).size(), " sharp images");
          },
          [&](const fs::path& folder) {
            so_far.latent_folder = folder;
            so_far.latents = load_latents(folder);
          }};
}

Stage poses_stage(const ImportOptions& options, Progressed& so_far) {
  return {"poses", text_of(options.poses),
          [&](const fs::path& folder) {
            const SearchResult result = find_poses(so_far.latent_folder, so_far.latents,
                                                   so_far.capture, options, folder / "colmap");
            keep_reconstruction(folder, result);
            if (!result.warning.empty()) log_warn(result.warning);
            return said_of(result);
          },
          [&](const fs::path& folder) { so_far.found = load_reconstruction(folder); }};
}

/// Corrects the light falloff of the frames.
Stage vignetting_stage(const ImportOptions& options, Progressed& so_far) {
  return {
      "vignetting", word_of(options.correct.vignetting),
      [&](const fs::path& folder) {
        Vignetting found{{}, 0, 0, 0, "not sought"};
        if (options.correct.vignetting == Correction::kAuto) {
          found = fit_vignetting(sample_brightness(so_far.capture, so_far.found, so_far.latents,
                                                   so_far.latent_folder));
        }
        keep_vignetting(folder, found);
        return found.said;
      },
      [&](const fs::path& folder) { remove_vignetting(load_vignetting(folder), so_far.capture); }};
}

Stage write_stage(const ImportOptions& options, const fs::path& output, Progressed& so_far) {
  return {"write", text_of(options.test),
          [&, output](const fs::path&) {
            // The data set is not written atomically: mark it as missing until it is complete.
            fs::remove_all(output / "import" / "write");
            return write_scene(output, so_far.capture, so_far.found, options);
          },
          [](const fs::path&) {}};
}

/// Whether `inner` is `outer` or inside it.
bool lies_in(const fs::path& inner, const fs::path& outer) {
  const fs::path in = fs::weakly_canonical(inner), out = fs::weakly_canonical(outer);
  return std::mismatch(out.begin(), out.end(), in.begin(), in.end()).first == out.end();
}

/// Rejects an output folder that contains the recording or files of another program.
void check_output(const ImportOptions& options, const fs::path& output) {
  for (const fs::path& given : {options.recording, options.frames}) {
    if (given.empty() || !fs::exists(given)) continue;
    if (!lies_in(output, given) && !lies_in(given, output)) continue;
    throw ConfigError(concat("--output: expected a folder apart from ", given.string(), ", found ",
                             output.string(), "; the data set would be written over what is read"));
  }
  if (!fs::exists(output) || fs::exists(output / "import")) return;
  if (fs::is_directory(output) && fs::is_empty(output)) return;
  throw ConfigError(
      concat("--output: expected a new or empty folder, or one of an earlier import, "
             "found other files in ",
             output.string(), "; choose another"));
}

/// Checks for COLMAP before minutes of work, if it will be needed.
void check_colmap(const ImportOptions& options, const StageRange& range) {
  const auto is_one_of = [](const std::string& name, std::initializer_list<const char*> names) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  if (is_one_of(range.until, {"read", "time", "sensor", "undistort", "restore"})) return;
  if (is_one_of(range.from, {"vignetting", "write"})) return;
  Progress progress("import", 1, 0, "stages");
  progress.show("looking for COLMAP");
  find_colmap(options.poses.colmap);
}

}  // namespace

void import_recording(const ImportOptions& given, const fs::path& output, const StageRange& range) {
  ImportOptions options = given;  // estimated thresholds replace the default ones
  if (!fs::exists(options.recording)) {
    throw DataError(concat(options.recording.string(), ": no such file or folder"));
  }
  check_output(options, output);
  check_colmap(options, range);
  if (!options.lens.mask.empty() && !fs::is_regular_file(options.lens.mask)) {
    throw DataError(concat(options.lens.mask.string(), ": no such mask file"));
  }
  if (!options.lens.calibration.empty()) calibration_of(options.lens, {});
  Progressed so_far;
  const std::vector<Stage> stages{
      read_stage(options, so_far),       time_stage(options, so_far),
      sensor_stage(options, so_far),     undistort_stage(options, so_far),
      restore_stage(options, so_far),    poses_stage(options, so_far),
      vignetting_stage(options, so_far), write_stage(options, output, so_far)};
  make_writable_folder(output / "import");
  const auto lock = FolderLock::take(output / "import");
  if (!lock) {
    throw DataError(concat(output.string(),
                           ": another jade_import is at work here; wait for it or choose another "
                           "--output"));
  }
  run_stages(output / "import", stages, range);
}

}  // namespace jade::import
