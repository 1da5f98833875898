// SPDX-License-Identifier: Apache-2.0
#include "jade/import/read_capture.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/median.h"
#include "jade/core/readable.h"
#include "jade/events/pixels.h"
#include "jade/events/stream_faults.h"
#include "jade/imaging/event_cover.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/unread_images.h"
#include "jade/import/bad_frames.h"
#include "jade/import/calibration.h"
#include "jade/import/exposure_length.h"
#include "jade/import/frame_masks.h"
#include "jade/import/undistortion.h"
#include "jade/recording/recording.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;

/// Longest exposure as a multiple of the frame period; both are rounded.
constexpr double kLongestExposure = 1.02;

/// Peak memory per event: 17 bytes each for its original and its processed form, and some for the
/// estimate of thresholds. A second camera's events exist once more, in the frames' view.
constexpr double kEventBytes = 45, kSecondCameraBytes = 17;

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
    std::error_code is_file;
    for (const auto& entry : fs::directory_iterator(recording.source, is_file)) {
      check_link(entry.path());
    }
    throw DataError(concat(source, ": holds no events; expected a recording of an event camera"));
  }
}

/// The factor of a unit by which frames last longer than events; 0 if they do not.
int64_t wrong_unit(const recording::Recording& recording) {
  constexpr double kAlike = 2;
  const auto frames_us =
      double(recording.frames.back().t_end_us - recording.frames.front().t_start_us);
  const auto events_us = double(recording.stored_us.end_us - recording.stored_us.begin_us);
  for (const int64_t factor : {1000, 1000000, 1000000000}) {
    const double shared = frames_us / double(factor);
    if (events_us > 0 && shared < kAlike * events_us && kAlike * shared > events_us) return factor;
  }
  return 0;
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
  const int64_t factor = wrong_unit(recording);
  throw DataError(
      concat(recording.source.string(), ": no event lies near a frame: frames from ",
             recording.frames.front().t_start_us, " to ", recording.frames.back().t_end_us, " us, ",
             recording.stored_events, " events from ", recording.stored_us.begin_us, " to ",
             recording.stored_us.end_us, " us; ",
             factor > 0 ? concat("the frames last about ", factor,
                                 " times as long as the events, so their times were read in a "
                                 "wrong unit: write them as seconds with six decimals in "
                                 "images.txt, or as whole us in another list")
                        : "the two clocks do not overlap, give the offset between them with "
                          "--offset-ms"));
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
  const double period_ms = double(median_step(starts)) / 1000;
  if (double(options.exposure_ms) <= kLongestExposure * period_ms) return;
  throw ConfigError(concat("--exposure-ms: expected at most the ", period_ms,
                           " ms from one frame to the next, found ", double(options.exposure_ms),
                           "; leave it out to have the length found"));
}

/// Copies the first calibration beside the recording that can be read into the stage's folder.
void keep_calibration(const fs::path& folder, const recording::Recording& recording) {
  for (const recording::CalibrationFile& found : recording.calibrations) {
    const fs::path copy = folder / "calibration" / found.name;
    make_writable_folder(copy.parent_path());
    write_file(copy, found.text);
    const std::string fault = calibration_fault(copy);
    if (fault.empty()) return;
    fs::remove_all(copy.parent_path());
    log_warn(concat((recording.source / found.name).string(), fault,
                    "; it is not used: give another with --calibration"));
  }
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

/// Whether rows [begin, end) of a frame have events at a rate like the others, from the frame
/// before to the next. False if events and frames do not share their pixels.
bool saw_change(const recording::Recording& recording, size_t index, int64_t begin, int64_t end) {
  constexpr int64_t kFewest = 100;
  constexpr double kAlike = 0.2;
  const std::vector<recording::Frame>& frames = recording.frames;
  const int64_t height = frames[index].image.size(1);
  const bool shared = recording.height == 0 || (recording.height == height &&
                                                recording.width == frames[index].image.size(2));
  if (!shared) return false;
  const int64_t from_us = frames[index == 0 ? 0 : index - 1].t_start_us;
  const int64_t to_us = frames[std::min(index + 1, frames.size() - 1)].t_end_us;
  const torch::Tensor y = recording.events.slice(from_us, to_us).y().round();
  const auto count = [](const torch::Tensor& which) { return which.sum().item<int64_t>(); };
  const int64_t within = count(y.ge(double(begin)).logical_and(y.lt(double(end))));
  const int64_t others = y.numel() - within;
  return within >= kFewest && double(within) * double(height - (end - begin)) >=
                                  kAlike * double(others) * double(end - begin);
}

/// Leaves out frames without a whole picture, which would mislead every estimate.
void drop_bad_frames(recording::Recording& recording) {
  std::vector<torch::Tensor> images;
  for (const recording::Frame& frame : recording.frames) images.push_back(frame.image);
  const std::vector<size_t> bad = bad_frames(images, [&](size_t index, int64_t begin, int64_t end) {
    return saw_change(recording, index, begin, end);
  });
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

/// Warns of events in a corner of the frames, as those of a sensor with fewer pixels are. The
/// reader warns where they reach the other sides.
void warn_of_fewer_pixels(const Capture& capture, const events::ImageSize& reach) {
  constexpr double kOtherSide = 0.9;
  if (double(reach.width) >= kOtherSide * double(capture.width()) &&
      double(reach.height) >= kOtherSide * double(capture.height()))
    return;
  const std::string fault =
      imaging::cover_fault(capture.events, capture.shots[capture.shots.size() / 2].image);
  if (!fault.empty()) log_warn(concat(capture.source, ": ", fault));
}

/// Events that were written twice would double all changes.
events::EventStream distinct_events(const recording::Recording& recording) {
  const events::DistinctEvents distinct = events::without_copies(recording.events);
  // Readers of lists have warned of copies that stay.
  if (distinct.copies > 0) log_warn(concat(recording.source.string(), ": ", distinct.fault));
  return distinct.events;
}

}  // namespace

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

Capture read_capture(const ImportOptions& options, const fs::path& folder) {
  recording::Recording recording =
      recording::read_recording(options.recording, read_options(options));
  check_overlap(recording);  // more informative than the note about omitted events
  for (const std::string& note : recording.notes) log_info("            " + note);
  for (const std::string& warning : recording.warnings) log_warn(warning);
  check_recording(recording, options.time);
  drop_bad_frames(recording);
  if (options.lens.calibration.empty()) keep_calibration(folder, recording);
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

fs::path kept_calibration(const fs::path& folder) {
  if (!fs::is_directory(folder / "calibration")) return {};
  for (const auto& entry : fs::directory_iterator(folder / "calibration")) return entry.path();
  return {};
}

void check_one_sensor(const Capture& capture) {
  constexpr double kManyBeside = 0.02;
  const auto width = double(capture.width()), height = double(capture.height());
  const torch::Tensor &x = capture.events.x(), &y = capture.events.y();
  events::ImageSize sensor = capture.sensor;
  if (!capture.sensor_is_said) {
    const torch::Tensor beside = x.ge(width - 0.5).logical_or(y.ge(height - 0.5));
    if (capture.events.empty()) return;
    sensor = reach_of(capture.events);
    if (beside.to(torch::kFloat32).mean().item<double>() < kManyBeside) {
      warn_of_fewer_pixels(capture, sensor);
      return;
    }
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

void drop_masked_events(Capture& capture) {
  const bool shared =
      capture.sensor.height == capture.height() && capture.sensor.width == capture.width();
  if (!capture.mask.defined() || !shared) return;
  capture.events = capture.events.select(events::kept_by(capture.mask[0], capture.events));
}

}  // namespace jade::import
