// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/event_folder.h"

#include <algorithm>
#include <sstream>
#include <string>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/io/npy.h"
#include "jade/io/stand_in.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;
using events::TimeUnit;

/// Description file in folders written by scripts/read_recording.py.
constexpr const char* kDescription = "recording.txt";

constexpr const char* kTextNames[] = {"events.txt", "events.txt.gz"};
constexpr const char* kOtherNames[] = {
    "events.h5",  "events.hdf5", "events/events.h5", "events/left/events.h5", "events_left.h5",
    "events.npz", "events.npy",  "events.csv",       "events.csv.gz",         "events.raw"};

/// The file of the events; with two cameras that of the left one.
fs::path events_in(const fs::path& folder) {
  for (const char* name : kOtherNames) {
    if (fs::is_regular_file(folder / name)) return folder / name;
  }
  // TUM-VIE: SEQUENCE-events_left.h5
  fs::path out;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    constexpr const char* kLeft = "-events_left.h5";
    const size_t at = name.rfind(kLeft);
    if (name[0] == '.' || at == std::string::npos || name.substr(at) != kLeft) continue;
    if (!out.empty()) return {};
    out = entry->path();
  }
  return out;
}

fs::path images_in(const fs::path& folder) {
  for (const char* name : {"images_1", "images", "frames", "images/left/rectified",
                           "images/left/distorted", "left_images"}) {
    if (fs::is_directory(folder / name) && !imaging::list_images(folder / name).empty())
      return folder / name;
  }
  return {};
}

/// A file in the folder of the images or its parent; empty if there is none.
fs::path beside_images(const fs::path& folder, const fs::path& images, const char* name) {
  for (const fs::path& path : {images / name, folder / name}) {
    if (fs::is_regular_file(path)) return path;
  }
  return {};
}

/// The first line is "format …"; other files of this name are the user's notes.
bool is_described(const fs::path& folder) {
  return fs::is_regular_file(folder / kDescription) &&
         read_file(folder / kDescription).rfind("format ", 0) == 0;
}

/// Lines "key value" of recording.txt.
void apply_description(const fs::path& path, Recording& recording, int64_t* offset_us) {
  std::istringstream text(read_file(path));
  for (std::string line; std::getline(text, line);) {
    std::istringstream words(line);
    std::string key, value;
    words >> key;
    std::getline(words >> std::ws, value);
    std::istringstream number(value);
    if (key == "format") recording.format = value;
    if (key == "stamp") recording.stamp = value_of<Stamp>(value).value_or(recording.stamp);
    if (key == "offset_us") number >> *offset_us;
    if (key == "width") number >> recording.width;
    if (key == "height") number >> recording.height;
    if (key == "note") recording.notes.push_back(value);
    if (key == "warning") recording.warnings.push_back(value);
  }
}

void add_edges(const fs::path& path, Triggers& triggers) {
  if (!fs::is_regular_file(path)) return;
  std::istringstream text(read_file(path));
  std::string header;
  std::getline(text, header);
  int64_t t = 0, rising = 0;
  for (char comma = 0; text >> t >> comma >> rising;)
    (rising ? triggers.rising_us : triggers.falling_us).push_back(t);
}

void move(int64_t offset_us, Triggers& triggers) {
  for (auto* edges : {&triggers.rising_us, &triggers.falling_us}) {
    for (int64_t& t : *edges) t += offset_us;
  }
}

/// Shifts the clock of events after reading.
ReadEvents moved(const ReadEvents& read, int64_t offset_us) {
  return [=](const Wanted& wanted, Recording& out) {
    Wanted theirs = wanted;
    const auto move_back = [&](events::TimeWindow& w) {
      w = {w.begin_us - offset_us, w.end_us - offset_us};
    };
    if (theirs.kept) std::for_each(theirs.kept->begin(), theirs.kept->end(), move_back);
    if (theirs.frames) move_back(*theirs.frames);
    read(theirs, out);
    const events::EventStream& e = out.events;
    out.events = {e.x(), e.y(), e.t_us() + offset_us, e.polarity()};
    out.stored_us = {out.stored_us.begin_us + offset_us, out.stored_us.end_us + offset_us};
  };
}

/// Reads recording.txt and triggers.csv of a folder that the script wrote.
void describe(const fs::path& folder, const ReadOptions& options, Contents& contents) {
  Recording& recording = contents.recording;
  int64_t offset_us = 0;
  apply_description(folder / kDescription, recording, &offset_us);
  add_edges(folder / "triggers.csv", recording.triggers);
  // Frames of another source belong to another camera.
  const fs::path camera = folder / "camera_info.yaml";
  if (options.frames.empty() && fs::is_regular_file(camera))
    recording.calibration = CalibrationFile{"camera_info.yaml", read_file(camera)};
  if (offset_us == 0) return;
  move(offset_us, recording.triggers);
  if (contents.read_events) contents.read_events = moved(contents.read_events, offset_us);
}

}  // namespace

void add_npz_times(const fs::path& path, TimeUnit wanted, std::vector<FrameFile>& files,
                   Recording& recording) {
  const io::Npz archive(path);
  const bool exposures = archive.has("timestamps_start") && archive.has("timestamps_end");
  const torch::Tensor start = archive.read(exposures ? "timestamps_start" : "timestamps");
  const torch::Tensor end = exposures ? archive.read("timestamps_end") : start;
  if (start.dim() != 1 || start.sizes() != end.sizes() || start.size(0) != int64_t(files.size())) {
    throw DataError(concat(path.string(), ": expected one time for each of ", files.size(),
                           " images, found ", start.numel(), " and ", end.numel(),
                           "; export it again"));
  }
  const TimeUnit unit = wanted == TimeUnit::kAuto ? events::guess_exposure_unit(
                                                        start, end, path.string(), "give the unit")
                                                  : wanted;
  if (wanted == TimeUnit::kAuto && unit == TimeUnit::kMs) {
    recording.notes.push_back(concat(path.string(), ": times are read as milliseconds"));
  }
  const auto from = events::times_us(start, unit, path.string());
  const auto to = events::times_us(end, unit, path.string());
  for (size_t i = 0; i < files.size(); ++i) {
    files[i].time = {from[i], to[i]};
    if (files[i].time->duration_us() >= 0) continue;
    throw DataError(concat(path.string(), ": frame ", i,
                           " ends before its start; swap the two "
                           "arrays"));
  }
  check_apart(path, files, recording);
  if (!exposures) {
    recording.notes.push_back(concat(path.string(),
                                     ": holds one time per frame; it is taken as the ",
                                     word_of(recording.stamp), " of the exposure"));
  }
}

bool is_event_folder(const fs::path& folder) {
  if (!events_in(folder).empty()) return true;
  for (const char* name : {"images_1", "images"}) {
    if (!beside_images(folder, folder / name, "timestamps.npz").empty() ||
        !beside_images(folder, folder / name, "exposures.csv").empty())
      return true;
  }
  return false;
}

fs::path text_events_in(const fs::path& folder) {
  for (const char* name : kTextNames) {
    std::error_code ignored;
    if (fs::is_regular_file(folder / name, ignored)) return folder / name;
  }
  return {};
}

void warn_of_other_events(const fs::path& folder, const fs::path& read, Recording& recording) {
  std::string others;
  const auto add = [&](const char* name) {
    std::error_code ignored;
    if (folder / name == read || !fs::is_regular_file(folder / name, ignored)) return;
    others += concat(others.empty() ? "" : ", ", name);
  };
  for (const char* name : kTextNames) add(name);
  for (const char* name : kOtherNames) add(name);
  if (others.empty()) return;
  recording.warnings.push_back(concat(folder.string(), ": expected one file of events, found ",
                                      others, " beside ", read.lexically_relative(folder).string(),
                                      ", which is read; remove those that do not count"));
}

std::vector<std::string> packed_files(const fs::path& folder) {
  std::vector<std::string> out;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path& path = entry->path();
    std::error_code ignored;
    if (path.filename().string()[0] == '.' || !entry->is_regular_file(ignored)) continue;
    const fs::path kind = path.extension();
    const bool is_read = path == text_events_in(folder) || path == events_in(folder);
    for (const char* ending : {".gz", ".tgz", ".bz2", ".xz", ".zst", ".7z", ".rar", ".tar"}) {
      if (kind != ending || is_read) continue;
      const std::string found = io::stand_in(path);
      if (!found.empty()) out.push_back(concat(path.filename().string(), ", ", found));
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

bool holds_bag(const fs::path& folder) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const auto kind = entry->path().extension();
    if (kind == ".db3" || kind == ".mcap") return true;
  }
  return false;
}

Contents read_event_folder(const fs::path& folder, const ReadOptions& given) {
  const bool described = is_described(folder);
  ReadOptions options = given;
  // the unit in which the script writes all times
  if (described) options.time_unit = TimeUnit::kUs;
  Contents out;
  Recording& recording = out.recording;
  recording.format = "folder of frames and events";
  recording.stamp = options.stamp.value_or(Stamp::kMiddle);
  const fs::path images = images_in(folder);
  if (!images.empty()) {
    for (const fs::path& file : imaging::list_images(images)) out.files.push_back({file, {}});
    if (const auto list = beside_images(folder, images, "exposures.csv"); !list.empty()) {
      apply_exposures(list, read_exposures(list), out.files, recording);
    } else if (const auto npz = beside_images(folder, images, "timestamps.npz"); !npz.empty()) {
      add_npz_times(npz, options.time_unit, out.files, recording);
    } else if (const auto lines = beside_images(folder, images, "images.txt");
               !lines.empty() && !fs::exists(lines.parent_path() / "cameras.txt")) {
      out.files = listed_images(lines, recording);
      recording.notes.push_back(concat(lines.string(),
                                       ": holds one time per frame in seconds; it is taken as the ",
                                       word_of(recording.stamp), " of the exposure"));
    } else {
      add_frame_list(images, options, out.files, recording);
    }
  }
  if (images.empty() && options.frames.empty()) warn_of_no_images(folder, recording);
  const fs::path events = events_in(folder);
  if (!events.empty()) {
    // With frames of another source, the offset refers to their clock, not to this folder's.
    const int64_t ahead_us = options.frames.empty() ? options.near_frames_ahead_us.value_or(0) : 0;
    out.read_events = events_of(events, options, span_of(out.files, ahead_us), recording);
    warn_of_other_events(folder, events, recording);
  }
  if (described) describe(folder, options, out);
  return out;
}

}  // namespace jade::recording
