// SPDX-License-Identifier: Apache-2.0
#include "jade/import/importer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
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
#include "jade/events/stream_faults.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/unread_images.h"
#include "jade/import/bad_frames.h"
#include "jade/import/capture.h"
#include "jade/import/colmap.h"
#include "jade/import/exposure_length.h"
#include "jade/import/findings.h"
#include "jade/import/frame_masks.h"
#include "jade/import/hot_pixels.h"
#include "jade/import/latents.h"
#include "jade/import/scene_files.h"
#include "jade/import/structure_from_motion.h"
#include "jade/import/undistortion.h"
#include "jade/import/vignetting.h"
#include "jade/recording/recording.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;

/// Three views are too few for a scene, and structure from motion cannot check itself.
constexpr size_t kFewestFrames = 4;
/// Longest exposure as a multiple of the frame period; both are rounded.
constexpr double kLongestExposure = 1.02;

/// Calls `visit` with each file below a folder, following links to other folders.
/// @param above  the ancestors of the folder and the folder itself; links to them are skipped
template <class Visit>
void for_files(const fs::path& folder, std::vector<fs::path> above, const Visit& visit) {
  std::error_code unreadable;
  above.push_back(fs::canonical(folder, unreadable));
  for (fs::directory_iterator entry(folder, unreadable), end; !unreadable && entry != end;
       entry.increment(unreadable)) {
    std::error_code ignored;
    if (entry->is_regular_file(ignored)) visit(entry->path());
    if (!entry->is_directory(ignored)) continue;
    const fs::path place = fs::canonical(entry->path(), ignored);
    if (std::find(above.begin(), above.end(), place) == above.end()) {
      for_files(entry->path(), above, visit);
    }
  }
}

/// Hashes names, sizes and modification times: hashing a recording of 10 GB would take a minute.
std::string fingerprint(const fs::path& path) {
  // Ignore unreadable files here; the reader reports them.
  std::error_code unreadable;
  const auto line = [&](const fs::path& file) {
    const auto changed = fs::last_write_time(file, unreadable).time_since_epoch();
    return concat(file.string(), ' ', fs::file_size(file, unreadable), ' ',
                  std::chrono::duration_cast<std::chrono::microseconds>(changed).count(), '\n');
  };
  if (fs::is_regular_file(path, unreadable)) return line(path);
  if (!fs::is_directory(path, unreadable)) return {};
  std::vector<std::string> lines;
  for_files(path, {}, [&](const fs::path& file) { lines.push_back(line(file)); });
  std::sort(lines.begin(), lines.end());
  std::string all;
  for (const std::string& each : lines) all += each;
  return all;
}

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

/// Peak memory per event: 17 bytes each for its original and its processed form, and some for the
/// estimate of thresholds. A second camera's events exist once more, in the frames' view.
constexpr double kEventBytes = 45, kSecondCameraBytes = 17;

/// The stamp that the options name.
std::optional<recording::Stamp> stamp_of(const TimeOptions& options) {
  switch (options.stamp) {
    case StampChoice::kStart:
      return recording::Stamp::kStart;
    case StampChoice::kMiddle:
      return recording::Stamp::kMiddle;
    case StampChoice::kEnd:
      return recording::Stamp::kEnd;
    case StampChoice::kAuto:
      break;
  }
  return std::nullopt;
}

recording::ReadOptions read_options(const ImportOptions& options) {
  recording::ReadOptions how;
  how.frames = options.frames;
  how.events_group = options.events_group;
  how.topic = options.topic;
  how.frames_topic = options.frames_topic;
  how.frame_times = options.time.frame_times;
  how.exposure_ms = double(options.time.exposure_ms);
  how.trigger_level = options.time.trigger_level;
  how.stamp = stamp_of(options.time);
  const double end_s = options.time.end_s > 0 ? options.time.end_s : 1e9;
  if (options.time.begin_s > 0 || options.time.end_s > 0) {
    how.since_first_frame =
        events::TimeWindow{std::llround(1e6 * options.time.begin_s), std::llround(1e6 * end_s)};
  }
  how.near_frames_ahead_us = std::llround(1e3 * options.time.offset_ms);
  how.event_bytes = kEventBytes + (options.lens.plane_depth > 0 ? kSecondCameraBytes : 0);
  return how;
}

/// Names files of a folder that are no images that are read.
std::string unread_images(const fs::path& source) {
  for (const fs::path& place : {source / "images_1", source / "images", source}) {
    if (std::string found = imaging::unread_images(place); !found.empty()) return found;
  }
  return "";
}

void check_recording(const recording::Recording& recording, const TimeOptions& time) {
  const std::string source = recording.source.string();
  if (recording.frames.empty() && (time.begin_s > 0 || time.end_s > 0)) {
    throw DataError(concat(source, ": no frame lies wholly between --begin-s ", time.begin_s,
                           " and --end-s ", time.end_s,
                           " after the first frame began; give a longer span, or frames with "
                           "--frames DIR if there are none"));
  }
  if (recording.frames.empty()) {
    throw DataError(
        recording.untimed_frames > 0
            ? concat(source, ": holds ", recording.untimed_frames,
                     " frames and no time of any; give --frame-times LIST.csv "
                     "(name,start_us,end_us)")
            : concat(source, ": holds no frames", unread_images(recording.source),
                     "; give a folder of them with --frames DIR, each named after a line of its "
                     "times"));
  }
  if (recording.stored_events == 0) {
    throw DataError(concat(source, ": holds no events; expected a recording of an event camera"));
  }
}

void check_overlap(const recording::Recording& recording) {
  if (recording.frames.empty() || recording.stored_events == 0) return;
  if (!recording.events.empty()) return;
  const bool stamped =
      std::any_of(recording.frames.begin(), recording.frames.end(),
                  [](const recording::Frame& f) { return f.t_start_us > 0 || f.t_end_us < 0; });
  if (!stamped) {
    throw DataError(concat(recording.source.string(), ": expected times of the frames, found ",
                           recording.frames.size(),
                           " frames with a stamp of 0: their driver wrote no times; give their "
                           "exposures with --frame-times"));
  }
  throw DataError(
      concat(recording.source.string(), ": no event lies near a frame: frames from ",
             recording.frames.front().t_start_us, " to ", recording.frames.back().t_end_us, " us, ",
             recording.stored_events, " events from ", recording.stored_us.begin_us, " to ",
             recording.stored_us.end_us,
             " us; the two clocks do not overlap, give the offset between them with --offset-ms"));
}

void check_shots(const Capture& capture) {
  const std::string& source = capture.source;
  if (capture.shots.size() < kFewestFrames) {
    throw DataError(concat(source, ": expected at least ", kFewestFrames,
                           " frames from different places, found ", capture.shots.size(),
                           "; record longer, or give more with --frames DIR"));
  }
}

/// A given length must fit between two frames.
void check_given_exposure(const TimeOptions& options, const Capture& capture) {
  const int64_t given_us = std::llround(1000 * double(options.exposure_ms));
  const auto has_it = [&](const Shot& shot) { return shot.duration_us() == given_us; };
  if (given_us == 0 || std::none_of(capture.shots.begin(), capture.shots.end(), has_it)) return;
  std::vector<int64_t> starts;
  for (const Shot& shot : capture.shots) starts.push_back(shot.t_start_us);
  const double period_ms = double(frame_period_us(starts)) / 1000;
  if (double(options.exposure_ms) <= kLongestExposure * period_ms) return;
  throw ConfigError(concat("--exposure-ms: expected at most the ", period_ms,
                           " ms from one frame to the next, found ", double(options.exposure_ms),
                           "; leave it out to have the length found"));
}

/// Without a calibration of two cameras, events and frames must share one pixel grid. If no file
/// has the size of the event sensor, its events must lie on the frames.
void check_one_sensor(const Capture& capture) {
  constexpr double kManyBeside = 0.02;
  const auto width = double(capture.width()), height = double(capture.height());
  const torch::Tensor &x = capture.events.x(), &y = capture.events.y();
  events::ImageSize sensor = capture.sensor;
  if (!capture.sensor_is_said) {
    const torch::Tensor beside = x.ge(width - 0.5).logical_or(y.ge(height - 0.5));
    if (capture.events.empty() || beside.to(torch::kFloat32).mean().item<double>() < kManyBeside)
      return;
    sensor = reach_of(capture.events);
  }
  if (sensor.width == capture.width() && sensor.height == capture.height()) return;
  throw DataError(
      concat(capture.source, ": expected events and frames of the same pixels, found events of ",
             sensor.width, "x", sensor.height, " px and frames of ", capture.width(), "x",
             capture.height(),
             " px; if the frames were cropped or resized, give them as the sensor took them, if "
             "they are of a second camera, give --calibration of both (Kalibr's cam0 for the "
             "frames, cam1 for the events) and --plane-depth METRES"));
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

/// Copies a calibration found beside the recording into the stage's folder.
void keep_calibration(const fs::path& folder, const recording::Recording& recording) {
  if (!recording.calibration) return;
  make_writable_folder(folder / "calibration");
  write_file(folder / "calibration" / recording.calibration->name, recording.calibration->text);
}

/// The file that keep_calibration wrote; empty if there is none.
fs::path kept_calibration(const fs::path& folder) {
  if (!fs::is_directory(folder / "calibration")) return {};
  for (const auto& entry : fs::directory_iterator(folder / "calibration")) return entry.path();
  return {};
}

/// Converts events to the clock of the frames.
void set_clock(double ahead_ms, Capture& capture) {
  const auto ahead_us = std::llround(1000 * ahead_ms);
  if (ahead_us == 0) return;
  const events::EventStream& e = capture.events;
  capture.events = events::EventStream(e.x(), e.y(), e.t_us() - ahead_us, e.polarity());
}

/// Assigns the masks stored with the frames: alpha, masks/ and mask.png. Pixels excluded in every
/// shot become the mask of all.
void add_masks(const recording::Recording& recording, Capture& capture) {
  std::vector<std::string> warnings;
  const std::vector<torch::Tensor> masks = masks_of(recording, warnings);
  for (const std::string& warning : warnings) log_warn(warning);
  if (masks.empty()) return;
  torch::Tensor common = masks.front();
  for (const torch::Tensor& mask : masks)
    common = common.defined() && mask.defined() ? common.logical_or(mask) : torch::Tensor();
  capture.mask = common;
  for (size_t i = 0; i < masks.size(); ++i) {
    const bool own = masks[i].defined() && !(common.defined() && masks[i].equal(common));
    if (own) capture.shots[i].mask = masks[i];
  }
}

/// Leaves out frames without a whole picture, which would mislead every estimate.
void drop_bad_frames(recording::Recording& recording) {
  std::vector<torch::Tensor> images;
  for (const recording::Frame& frame : recording.frames) images.push_back(frame.image);
  const std::vector<size_t> bad = bad_frames(images);
  if (bad.empty()) return;
  constexpr size_t kNamed = 8;
  std::string names;
  for (size_t i = 0; i < std::min(bad.size(), kNamed); ++i)
    names += (i == 0 ? "" : ", ") + recording.frames[bad[i]].name;
  log_warn(concat(recording.source.string(), ": expected frames with a whole picture, found ",
                  bad.size(), " of ", images.size(), " blank or half written (", names,
                  bad.size() > kNamed ? ", ..." : "",
                  "); they are left out, export them again if they should count"));
  for (size_t k = bad.size(); k-- > 0;)
    recording.frames.erase(recording.frames.begin() + std::ptrdiff_t(bad[k]));
}

/// Events that were written twice would double all changes.
events::EventStream distinct_events(const recording::Recording& recording) {
  events::DistinctEvents distinct = events::without_copies(recording.events);
  if (distinct.copies > 0) {
    log_warn(concat(recording.source.string(), ": expected each event once, found ",
                    grouped(distinct.copies), " of ", grouped(recording.events.size()),
                    " that repeat the time, place and polarity of another; these are left out, "
                    "check how the file was written or joined"));
  }
  return distinct.events;
}

Capture read_capture(const ImportOptions& options, const fs::path& folder) {
  recording::Recording recording =
      recording::read_recording(options.recording, read_options(options));
  check_overlap(recording);  // more informative than the note about omitted events
  for (const std::string& note : recording.notes) log_info("            " + note);
  for (const std::string& warning : recording.warnings) log_warn(warning);
  check_recording(recording, options.time);
  drop_bad_frames(recording);
  keep_calibration(folder, recording);
  Capture capture;
  capture.source = recording.source.string();
  capture.format = recording.format;
  for (recording::Frame& frame : recording.frames) {
    capture.shots.push_back({frame.name, frame.image, frame.t_start_us, frame.t_end_us});
  }
  add_masks(recording, capture);
  std::stable_sort(capture.shots.begin(), capture.shots.end(),
                   [](const Shot& a, const Shot& b) { return a.t_start_us < b.t_start_us; });
  capture.events = distinct_events(recording);
  capture.sensor = {recording.height, recording.width};
  capture.sensor_is_said = recording.size_is_said;
  if (capture.sensor.height == 0) capture.sensor = {capture.height(), capture.width()};
  check_shots(capture);
  check_given_exposure(options.time, capture);
  return capture;
}

/// The mask of all frames; undefined without one.
torch::Tensor read_mask(const fs::path& path, const Capture& capture) {
  if (path.empty()) return {};
  torch::Tensor mask = imaging::read_mask(path);
  if (mask.size(1) != capture.height() || mask.size(2) != capture.width()) {
    throw DataError(concat(path.string(), ": expected a mask of ", capture.width(), "x",
                           capture.height(), " px, as the frames have, found ", mask.size(2), "x",
                           mask.size(1), "; make it at the size of the frames"));
  }
  if (!mask.any().item<bool>()) {
    throw DataError(
        concat(path.string(), ": expected a mask with pixels that count (not black), found none"));
  }
  return mask;
}

/// Drops the events of excluded pixels if frames and events share their pixels, so that exposures,
/// clock, thresholds and COLMAP's images do not depend on them.
void drop_masked_events(Capture& capture) {
  const bool shared =
      capture.sensor.height == capture.height() && capture.sensor.width == capture.width();
  if (!capture.mask.defined() || !shared) return;
  capture.events = remove_events(capture.events, capture.mask[0].logical_not());
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

Stage read_stage(const ImportOptions& options, Progressed& so_far) {
  return {"read",
          concat(fingerprint(options.recording), fingerprint(options.frames),
                 masks_text(options.frames), fingerprint(options.time.frame_times),
                 text_of(options.time), options.events_group, "\n", options.topic,
                 options.frames_topic.empty() ? "" : "\n" + options.frames_topic),
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
