// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/recording.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/events/stream_faults.h"
#include "jade/imaging/event_cover.h"
#include "jade/recording/contents.h"
#include "jade/recording/event_folder.h"
#include "jade/recording/format.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

/// Events that span this share of the frames in both directions come from the same sensor.
constexpr double kSameSensor = 0.9;
/// Rectified events leave the image at its borders; more than this share is another image.
constexpr double kManyBeside = 0.02;
/// Events within this time of a frame are kept; estimates of thresholds and clocks use frames less
/// than twice this apart.
constexpr int64_t kLeastReachUs = 250000;

Contents read_contents(const fs::path& path, const ReadOptions& options) {
  switch (recognise(path)) {
    case Format::kEvt:
      return read_evt(path, options);
    case Format::kDat:
      return read_dat(path, options);
    case Format::kZip:
      return read_zip(path, options);
    case Format::kFrameFolder:
      return read_event_folder(path, options);
    case Format::kAedat:
    case Format::kRosBag:
      return read_converted(path, options);
    case Format::kHdf5:
      return is_metavision(path, options.events_group) ? read_metavision(path, options)
                                                       : read_event_file(path, options);
    case Format::kNpz:
    case Format::kNpy:
    case Format::kText:
      return read_event_file(path, options);
  }
  throw ContractError("recognise: a format without a reader");
}

/// Only some formats can have several event streams.
void check_choice(const fs::path& path, const ReadOptions& options) {
  const Format format = recognise(path);
  for (const auto& [topic, flag] :
       {std::pair{options.topic, "--topic"}, std::pair{options.frames_topic, "--frames-topic"}}) {
    if (topic.empty() || format == Format::kRosBag || format == Format::kAedat) continue;
    throw DataError(concat(path.string(),
                           ": expected a ROS bag or AEDAT, of which a topic is chosen (", topic,
                           "), found ", word_of(format), "; leave ", flag, " out"));
  }
  // A folder may contain HDF5; its reader decides.
  const bool hdf5 = format == Format::kHdf5 || format == Format::kFrameFolder;
  if (!options.events_group.empty() && !hdf5) {
    throw DataError(concat(path.string(), ": expected HDF5, of which a group is chosen (",
                           options.events_group, "), found ", word_of(format),
                           format == Format::kRosBag ? "; choose a topic with --topic"
                                                     : "; leave --events-group out"));
  }
}

/// Drops frames and triggers outside the span.
void cut_to(const events::TimeWindow& window, Contents& contents) {
  Recording& recording = contents.recording;
  for (auto* edges : {&recording.triggers.rising_us, &recording.triggers.falling_us}) {
    edges->erase(
        std::remove_if(edges->begin(), edges->end(),
                       [&](int64_t t) { return t < window.begin_us || t >= window.end_us; }),
        edges->end());
  }
  auto& files = contents.files;
  files.erase(std::remove_if(files.begin(), files.end(),
                             [&](const FrameFile& file) {
                               return file.time && (file.time->begin_us < window.begin_us ||
                                                    file.time->end_us > window.end_us);
                             }),
              files.end());
}

/// The requested span, absolute or relative.
std::optional<events::TimeWindow> wanted_span(const ReadOptions& options,
                                              const Contents& contents) {
  if (!options.since_first_frame) return options.window;
  int64_t first_us = INT64_MAX;
  for (const FrameFile& file : contents.files) {
    if (file.time) first_us = std::min(first_us, file.time->begin_us);
  }
  if (first_us == INT64_MAX) return options.window;
  const events::TimeWindow& since = *options.since_first_frame;
  return events::TimeWindow{first_us + since.begin_us, first_us + since.end_us};
}

/// Spans around frames, by the clock of the events; overlapping ones are merged.
std::vector<events::TimeWindow> near_frames(const std::vector<FrameFile>& files, int64_t ahead_us) {
  int64_t reach_us = kLeastReachUs;
  std::vector<events::TimeWindow> spans;
  for (const FrameFile& file : files) {
    if (file.time) reach_us = std::max(reach_us, 2 * file.time->duration_us());
  }
  for (const FrameFile& file : files) {
    if (!file.time) continue;
    spans.push_back(
        {file.time->begin_us - reach_us + ahead_us, file.time->end_us + reach_us + ahead_us});
  }
  std::sort(spans.begin(), spans.end(),
            [](const auto& a, const auto& b) { return a.begin_us < b.begin_us; });
  std::vector<events::TimeWindow> joined;
  for (const events::TimeWindow& span : spans) {
    if (joined.empty() || span.begin_us > joined.back().end_us) {
      joined.push_back(span);
    } else {
      joined.back().end_us = std::max(joined.back().end_us, span.end_us);
    }
  }
  return joined;
}

Kept kept_spans(const ReadOptions& options, const std::optional<events::TimeWindow>& span,
                const Contents& contents) {
  std::vector<events::TimeWindow> spans;
  if (options.near_frames_ahead_us)
    spans = near_frames(contents.files, *options.near_frames_ahead_us);
  if (spans.empty()) return span ? Kept({*span}) : std::nullopt;
  if (!options.window) return spans;
  std::vector<events::TimeWindow> inside;
  for (const events::TimeWindow& s : spans) {
    const events::TimeWindow both{std::max(s.begin_us, span->begin_us),
                                  std::min(s.end_us, span->end_us)};
    if (both.begin_us < both.end_us) inside.push_back(both);
  }
  return inside;
}

/// Number of pixels that these coordinates span. Rectified coordinates are fractional; invalid ones
/// may have any value.
double reach_of(const torch::Tensor& places) {
  const torch::Tensor finite = places.masked_select(places.isfinite());
  return finite.numel() == 0 ? 0 : std::floor(finite.max().item<double>() + 0.5) + 1;
}

/// Share of the events outside an image of this size.
double share_beside(const events::EventStream& events, double width, double height) {
  const torch::Tensor beside = events.x().ge(width - 0.5).logical_or(events.y().ge(height - 0.5));
  return beside.sum().item<double>() / double(events.size());
}

/// Whether an image is reduced by one factor of 1.5 or more.
bool is_scaled(double right, double bottom) {
  constexpr double kLeast = 1.5, kShape = 0.05;
  return right >= kLeast && bottom >= kLeast && std::abs(right / bottom - 1) <= kShape;
}

/// Rejects coordinates that count from 1, which lie a pixel beside the frames.
void check_first_pixel(const Recording& recording) {
  if (recording.frames.empty() || recording.events.empty()) return;
  const torch::Tensor& image = recording.frames.front().image;
  const bool said = recording.width > 0;
  const events::ImageSize size{said ? recording.height : image.size(1),
                               said ? recording.width : image.size(2)};
  const std::string fault = events::one_based_fault(recording.events, size);
  if (!fault.empty()) throw DataError(concat(recording.source.string(), ": ", fault));
}

void check_places(const Recording& recording) {
  const std::string fault = events::place_fault(recording.events);
  if (!fault.empty()) throw DataError(concat(recording.source.string(), ": ", fault));
}

/// Infers the sensor's size from frames of the event sensor itself.
void find_sensor_size(Recording& recording) {
  recording.size_is_said = recording.width > 0;
  if (recording.size_is_said || recording.frames.empty() || recording.events.empty()) return;
  const torch::Tensor& image = recording.frames.front().image;
  const double width = double(image.size(2)), height = double(image.size(1));
  const double right = reach_of(recording.events.x()), bottom = reach_of(recording.events.y());
  const bool inside = right <= width && bottom <= height;
  if (inside && right >= kSameSensor * width && bottom >= kSameSensor * height) {
    recording.width = image.size(2), recording.height = image.size(1);
    return;
  }
  const std::string sizes = concat("events lie within ", right, "x", bottom, " px, frames are ",
                                   width, "x", height, " px: ");
  if (!inside && share_beside(recording.events, width, height) > kManyBeside) {
    recording.warnings.push_back(
        concat("expected frames of the event sensor's pixels, but ", sizes,
               is_scaled(right / width, bottom / height)
                   ? "the frames seem to be reduced, or of another camera"
                   : "the frames seem to be cropped or resized, or of another camera",
               "; give frames with the pixels of the events, or --calibration of both cameras"));
    return;
  }
  recording.notes.push_back(
      concat(sizes, "two cameras, or few events; the size of the event sensor is not known"));
}

/// Drops events outside the sensor; rectified ones between its pixels stay.
void drop_outside(Recording& recording) {
  if (recording.width == 0 || recording.events.empty()) return;
  const events::EventStream& all = recording.events;
  const torch::Tensor inside = all.x()
                                   .ge(-0.5)
                                   .logical_and(all.x().lt(double(recording.width) - 0.5))
                                   .logical_and(all.y().ge(-0.5))
                                   .logical_and(all.y().lt(double(recording.height) - 0.5));
  const int64_t outside = all.size() - inside.sum().item<int64_t>();
  if (outside == 0) return;
  recording.warnings.push_back(concat(outside, " of ", all.size(), " events lie beside the ",
                                      recording.width, "x", recording.height,
                                      " sensor and were dropped"));
  recording.events = all.select(inside);
}

void note_strays(Recording& recording) {
  std::string strays = events::drop_strays(recording.events);
  if (!strays.empty()) recording.warnings.push_back(std::move(strays));
}

void note_frames(Recording& recording) {
  if (recording.frames.empty()) {
    recording.notes.push_back("there are no frames");
    return;
  }
  const auto unknown = std::count_if(recording.frames.begin(), recording.frames.end(),
                                     [](const Frame& f) { return f.t_start_us == f.t_end_us; });
  if (unknown > 0) {
    recording.notes.push_back(
        concat(unknown, " of ", recording.frames.size(),
               " frames carry no length of their exposure; their time is taken as its ",
               word_of(recording.stamp)));
  }
}

/// Formats seconds: clocks count from 1970 or from the start of a sensor, so six digits are not
/// enough.
std::string seconds_of(int64_t t_us) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3f", 1e-6 * double(t_us));
  return text;
}

void note_clocks(const ReadOptions& options, Recording& recording) {
  const auto& frames = recording.frames;
  if (frames.empty() || recording.events.empty()) return;
  const bool all = options.most_events == 0;
  const int64_t first = all ? recording.events.first_us() : recording.stored_us.begin_us;
  const int64_t last = all ? recording.events.last_us() : recording.stored_us.end_us;
  const auto covered = std::count_if(frames.begin(), frames.end(), [&](const Frame& f) {
    return f.t_end_us >= first && f.t_start_us <= last;
  });
  if (covered == int64_t(frames.size())) return;
  const auto without_stamp = std::count_if(frames.begin(), frames.end(), [](const Frame& f) {
    return f.t_start_us <= 0 && f.t_end_us >= 0;
  });
  // A single frame may begin at 0.
  if (covered == 0 && first > 0 && without_stamp == int64_t(frames.size())) {
    recording.warnings.push_back(
        concat("all ", frames.size(),
               " frames have a stamp of 0: their driver wrote no times; give "
               "their exposures with --frame-times"));
    return;
  }
  recording.warnings.push_back(
      concat(frames.size() - size_t(covered), " of ", frames.size(),
             " frames lie outside the time of the events (", seconds_of(first), " to ",
             seconds_of(last), " s)",
             covered == 0 ? "; the two clocks may differ"
                          : "; if the events ended early, cut these off with --begin-s, --end-s"));
}

/// Notes exposures without events among those that the events cover, else stretches without any.
/// @param ahead_us  of the events' clock relative to the frames'
void note_pauses(int64_t ahead_us, Recording& recording) {
  constexpr int64_t kShortestUs = 1000;  // shorter exposures may fall between two events
  if (recording.events.empty()) return;
  const int64_t first = recording.events.first_us(), last = recording.events.last_us();
  std::vector<std::string> without;
  std::vector<events::NamedWindow> exposures;
  for (const Frame& frame : recording.frames) {
    const int64_t begin = frame.t_start_us + ahead_us, end = frame.t_end_us + ahead_us;
    if (end - begin < kShortestUs || begin < first || end > last) continue;
    exposures.push_back({frame.name, {begin, end}});
    if (recording.events.slice(begin, end).empty()) without.push_back(frame.name);
  }
  if (exposures.empty()) return;
  if (without.empty()) {
    const std::string fault = events::silence_fault(exposures, events::silences(recording.events));
    if (!fault.empty()) {
      recording.warnings.push_back(
          fault + ", or a camera that stops at once; record again, or leave these frames out");
    }
    return;
  }
  recording.warnings.push_back(concat(without.size(), " of ", recording.frames.size(),
                                      " exposures have no events (the first is ", without.front(),
                                      "), although events come before and after; did the recording "
                                      "lose events, or the camera stand still?"));
}

/// Notes faults of the events as a whole.
void note_events(Recording& recording) {
  std::vector<std::string> faults{events::polarity_fault(recording.events),
                                  events::resolution_fault(recording.events)};
  if (!recording.frames.empty()) {
    const torch::Tensor& image = recording.frames[recording.frames.size() / 2].image;
    const bool shared = recording.width == image.size(2) && recording.height == image.size(1);
    if (shared) faults.push_back(imaging::cover_fault(recording.events, image));
  }
  for (const std::string& fault : faults) {
    if (!fault.empty()) recording.warnings.push_back(fault);
  }
}

/// Notes files of a recording that no reader uses.
void note_unused(const fs::path& path, Recording& recording) {
  const fs::path folder = fs::is_directory(path) ? path : path.parent_path();
  const auto has = [&](const std::string& name) {
    std::error_code ignored;
    return fs::is_regular_file(folder / name, ignored);
  };
  for (const char* const map :
       {"rectify_map.h5", "events/rectify_map.h5", "events/left/rectify_map.h5"}) {
    if (!has(map)) continue;
    recording.notes.push_back(concat((folder / map).string(),
                                     ": DSEC's map of the events is not used; give the cameras "
                                     "with --calibration, by which events are rectified"));
    break;
  }
  const bool lacks = recording.stored_events == 0 || recording.frames.empty();
  for (const std::string& packed : lacks ? packed_files(path) : std::vector<std::string>())
    recording.warnings.push_back(concat(folder.string(), ": has ", packed));
  std::string found;
  for (const char* const poses :
       {"poses.txt", "poses.csv", "groundtruth.txt", "groundtruth.csv", "ground_truth.txt",
        "stamped_groundtruth.txt", "trajectory.txt", "pose.txt"}) {
    if (has(poses)) found += concat(found.empty() ? "" : ", ", poses);
  }
  if (found.empty()) return;
  recording.notes.push_back(concat(folder.string(), ": has poses (", found,
                                   "), which are not used, as the import finds its own; to train "
                                   "with them, make a data set with poses (docs/data.md)"));
}

/// Folder that may contain masks of the frames.
fs::path mask_root(const fs::path& path, const ReadOptions& options, const Contents& contents) {
  const auto whole = [](const fs::path& folder) {
    const fs::path absolute = fs::absolute(folder).lexically_normal();
    return absolute.has_filename() ? absolute : absolute.parent_path();
  };
  if (!options.frames.empty())
    return fs::is_directory(options.frames) ? whole(options.frames).parent_path() : fs::path();
  if (contents.keep) return contents.recording.mask_root;  // unpacked from an archive
  return fs::is_directory(path) ? path : fs::path();
}

/// Warns of exposures in another unit than the events: they fill a hundredth of the time, at an
/// implausible rate.
void check_unit(const Recording& recording) {
  constexpr double kShare = 0.01;
  constexpr size_t kFewest = 3;
  constexpr int64_t kShortestPeriodUs = 1000;
  const auto& frames = recording.frames;
  if (frames.size() < kFewest || recording.stored_events == 0) return;
  const int64_t span_us = frames.back().t_start_us - frames.front().t_start_us;
  const int64_t events_us = recording.stored_us.end_us - recording.stored_us.begin_us;
  if (span_us <= 0 || span_us >= kShortestPeriodUs * int64_t(frames.size() - 1)) return;
  if (double(span_us) > kShare * double(events_us)) return;
  throw DataError(concat(recording.source.string(),
                         ": expected times of frames in microseconds, "
                         "found ",
                         frames.size(), " frames within ", span_us, " us and events over ",
                         events_us,
                         " us; are the times of the frames in milliseconds? Convert them"));
}

/// Reads the files of `contents`. @param path  of the recording
void complete(const fs::path& path, const ReadOptions& options, Contents& contents) {
  Recording& recording = contents.recording;
  if (!options.frames.empty()) replace_frames(options.frames, options, contents);
  complete_exposures(options, contents);
  const auto span = wanted_span(options, contents);
  if (span) cut_to(*span, contents);
  const Wanted wanted{kept_spans(options, span, contents),
                      span_of(contents.files, options.near_frames_ahead_us.value_or(0))};
  if (contents.read_events) contents.read_events(wanted, recording);
  if (!wanted.kept) note_strays(recording);
  recording.mask_root = mask_root(path, options, contents);
  read_frames(std::move(contents.files), recording);
  check_unit(recording);
  check_places(recording);
  check_first_pixel(recording);
  find_sensor_size(recording);
  drop_outside(recording);
  if (recording.stored_events == 0) recording.notes.push_back("there are no events");
  note_frames(recording);
  note_clocks(options, recording);
  note_pauses(options.near_frames_ahead_us.value_or(0), recording);
  note_events(recording);
  note_unused(path, recording);
}

}  // namespace

Recording read_recording(const fs::path& given, const ReadOptions& options) {
  const fs::path path = recording_in(given);
  check_choice(path, options);
  Contents contents = read_contents(path, options);
  Recording& recording = contents.recording;
  recording.source = path;
  if (path != given)
    recording.notes.push_back(concat(path.string(), ": the only recording of the folder is read"));
  try {
    complete(path, options, contents);
  } catch (const DataError& error) {
    throw DataError(renamed(contents.made, error.what()));
  }
  for (auto* const lines : {&recording.notes, &recording.warnings}) {
    for (std::string& line : *lines) line = renamed(contents.made, std::move(line));
  }
  return std::move(recording);
}

}  // namespace jade::recording
