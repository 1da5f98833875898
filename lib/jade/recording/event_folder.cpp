// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/event_folder.h"

#include <algorithm>
#include <fstream>
#include <initializer_list>
#include <sstream>
#include <string>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/events/event_files.h"
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

/// Usual names of the events, those of two cameras with the left one; text first.
constexpr const char* kEventNames[] = {
    "events.txt",     "events.txt.gz",    "events.h5",
    "events.hdf5",    "events/events.h5", "events/left/events.h5",
    "events_left.h5", "events.npz",       "events.npy",
    "events.csv",     "events.csv.gz",    "events.tsv",
    "events.tsv.gz",  "events.raw"};

/// Endings of lists of numbers.
constexpr std::initializer_list<const char*> kTextEndings = {".txt", ".csv", ".tsv"};

/// Parts of names of folders whose images are no frames.
constexpr const char* kMaps[] = {"class",   "depth",  "disparity", "event",   "flow",   "label",
                                 "mask",    "normal", "plot",      "preview", "render", "result",
                                 "segment", "semant", "thumb",     "viz"};

bool has_ending_of(const std::string& name, std::initializer_list<const char*> endings) {
  return std::any_of(endings.begin(), endings.end(),
                     [&](const char* ending) { return has_ending(name, ending); });
}

/// Whether one of a text file's first lines of numbers has t, x, y and p. Packed files are assumed
/// to.
bool lists_events(const fs::path& path) {
  if (has_ending(in_small_letters(path.filename().string()), ".gz")) return true;
  constexpr int kMostLines = 100, kMostRows = 3;  // the first row may be the sensor's size
  std::ifstream text(path);
  std::string line;
  for (int i = 0, rows = 0; i < kMostLines && rows < kMostRows && std::getline(text, line); ++i) {
    std::replace_if(
        line.begin(), line.end(), [](char c) { return c == ',' || c == ';'; }, ' ');
    std::istringstream words(line);
    std::vector<double> row;
    for (std::string word; words >> word;) {
      const std::optional<double> value = number_in(word);
      if (!value) break;
      row.push_back(*value);
    }
    if (row.empty()) continue;
    ++rows;
    const auto is_sign = [](double v) { return v == 0 || v == 1 || v == -1; };
    if (row.size() == 4 && std::any_of(row.begin(), row.end(), is_sign)) return true;
    // v2e labels its noise in a fifth column, behind the polarity.
    if (row.size() == 5 && is_sign(row[3]) && is_sign(row[4])) return true;
  }
  return false;
}

/// Files of events in a folder, sorted; arrays, or text where there are none.
/// @param word  which their names have, in small letters; empty: any
std::vector<fs::path> event_files_in(const fs::path& folder, const std::string& word) {
  std::vector<fs::path> arrays, text;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = in_small_letters(entry->path().filename().string());
    const auto has = [&](const char* part) { return name.find(part) != std::string::npos; };
    const bool is_other = has("voxel") || has("frame") || has("imu") || has("rectif") ||
                          has("exposure") || has("timestamp") || has_ending(name, "_right.h5");
    if (name[0] == '.' || name.find(word) == std::string::npos || is_other ||
        !is_file(entry->path()))
      continue;
    const std::string unpacked = has_ending(name, ".gz") ? name.substr(0, name.size() - 3) : name;
    if (has_ending_of(name, {".h5", ".hdf5", ".hdf", ".npz", ".npy", ".raw"})) {
      arrays.push_back(entry->path());
    } else if (has_ending_of(unpacked, kTextEndings) && lists_events(entry->path())) {
      text.push_back(entry->path());
    }
  }
  std::vector<fs::path>& out = arrays.empty() ? text : arrays;
  std::sort(out.begin(), out.end());
  return out;
}

/// Whether a file is empty, or a short text whose lines are comments or a header.
bool is_blank(const fs::path& path) {
  constexpr uintmax_t kShort = 4096;
  std::error_code error;
  const uintmax_t bytes = fs::file_size(path, error);
  const bool is_text = has_ending_of(in_small_letters(path.filename().string()), kTextEndings);
  if (error || bytes == 0 || bytes > kShort || !is_text) return !error && bytes == 0;
  std::ifstream text(path);
  for (std::string line; std::getline(text, line);) {
    const auto first = line.find_first_not_of(" \t\r");
    if (first != std::string::npos && line.find_first_of("0123456789+-.", first) == first)
      return false;
  }
  return true;
}

/// Whether the files of events of a folder are those that read_events joins, blank ones aside.
bool are_chunks(const fs::path& folder, std::vector<fs::path> files) {
  std::vector<fs::path> chunks = events::event_chunks(folder);
  for (std::vector<fs::path>* list : {&files, &chunks})
    list->erase(std::remove_if(list->begin(), list->end(), is_blank), list->end());
  return !chunks.empty() && files == chunks;
}

/// The file of the events: one of the usual names, else the only one whose name says so, else the
/// folder events/ if it has numbered files of one stream. A file without events only if there is no
/// other.
fs::path events_in(const fs::path& folder) {
  fs::path blank;
  for (const char* name : kEventNames) {
    if (!is_file(folder / name)) continue;
    if (!is_blank(folder / name)) return folder / name;
    if (blank.empty()) blank = folder / name;
  }
  for (const auto& [where, word] :
       {std::pair(folder, "events"), std::pair(folder / "events", "")}) {
    std::vector<fs::path> files = event_files_in(where, word);
    if (!blank.empty())
      files.erase(std::remove_if(files.begin(), files.end(), is_blank), files.end());
    if (files.size() == 1) return files.front();
    if (where != folder && are_chunks(where, files)) return where;
    if (!files.empty()) return blank;
  }
  return blank;
}

bool is_text(const fs::path& events) {
  const std::string name = events.filename().string();
  return has_ending(name, ".txt") || has_ending(name, ".txt.gz");
}

/// Whether the images of a folder below the recording's may be no frames of its camera: maps,
/// plots, or those of the right camera.
bool may_be_others(const fs::path& images, const fs::path& folder) {
  for (const fs::path& part : images.lexically_relative(folder)) {
    const std::string name = in_small_letters(part.string());
    if (name == "right" || name.rfind("right_", 0) == 0 || has_ending(name, "_right")) return true;
    for (const char* map : kMaps) {
      if (name.find(map) != std::string::npos) return true;
    }
  }
  return false;
}

/// The only folder below with images that may be frames. Empty: none, or several.
fs::path only_images_below(const fs::path& folder) {
  std::vector<fs::path> found = image_folders(folder);
  found.erase(std::remove_if(found.begin(), found.end(),
                             [&](const fs::path& images) { return may_be_others(images, folder); }),
              found.end());
  return found.size() == 1 ? found.front() : fs::path();
}

/// Folders of the images: those of usual names, else the recording's own unless a folder in it has
/// more images. None without images.
std::vector<fs::path> images_in(const fs::path& folder) {
  std::vector<fs::path> out;
  for (const char* name : {"images_1", "images", "frames", "images/left/rectified",
                           "images/left/distorted", "left_images"}) {
    if (count_images(folder / name) > 0) out.push_back(folder / name);
  }
  if (!out.empty()) return out;
  const size_t own = count_images(folder);
  if (own == 0) return {};
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = in_small_letters(entry->path().filename().string());
    if (name[0] != '.' && name != "masks" && count_images(entry->path()) > own) return {};
  }
  return {folder};
}

/// Whether frames are exposed while there are events.
bool overlap(const fs::path& events, const ReadOptions& options,
             const std::optional<events::TimeWindow>& frames) {
  Recording look;
  try {
    const auto exposures = is_text(events) ? std::nullopt : frames;
    events_of(events, options, exposures, look)({Kept(std::in_place), frames}, look);
  } catch (const DataError&) {
    return false;
  }
  return look.stored_events > 0 && frames->begin_us <= look.stored_us.end_us &&
         look.stored_us.begin_us <= frames->end_us;
}

/// The images of a folder that is only assumed to be that of the frames, if they have times that
/// fit the events or the user gives their times; else none, and `recording` is as before.
std::vector<FrameFile> fitting_images(const fs::path& images, const fs::path& root,
                                      const fs::path& events, const ReadOptions& options,
                                      Recording& recording) {
  Recording found = recording;
  std::vector<FrameFile> files;
  try {
    files = timed_images(images, root, options, found);
  } catch (const DataError&) {
    return {};
  }
  const bool given = !options.frame_times.empty();
  const auto span = span_of(files, options.near_frames_ahead_us.value_or(0));
  if (!given && (!span || (!events.empty() && !overlap(events, options, span)))) return {};
  recording = std::move(found);
  return files;
}

/// The images of the first of these folders, or of another that has fitting times if the first has
/// none.
/// @param places  their folders, those of images_in(); the first becomes that of the images
std::vector<FrameFile> images_with_times(std::vector<fs::path>& places, const fs::path& root,
                                         const fs::path& events, const ReadOptions& options,
                                         Recording& recording) {
  const Recording before = recording;
  const fs::path first = places.empty() ? fs::path() : places.front();
  std::vector<FrameFile> files = timed_images(first, root, options, recording);
  const auto note = [&](const std::string& what) {
    recording.notes.push_back(
        concat(places.front().string(), ": its images are read as the frames", what));
  };
  if (places.empty()) {
    const fs::path only = files.empty() ? only_images_below(root) : fs::path();
    if (only.empty()) return files;
    files = fitting_images(only, root, events, options, recording);
    if (files.empty()) return files;
    places = {only};
    note("");
    return files;
  }
  if (places.size() == 1) return files;
  for (size_t i = 1; i < places.size() && options.frame_times.empty() && !span_of(files, 0); ++i) {
    Recording other = before;
    std::vector<FrameFile> found = fitting_images(places[i], root, events, options, other);
    if (found.empty()) continue;
    files = std::move(found), recording = std::move(other);
    std::swap(places[0], places[i]);
  }
  std::vector<std::string> others;
  for (size_t i = 1; i < places.size(); ++i)
    others.push_back(places[i].lexically_relative(root).string());
  note(concat(", not those of ", listing(others), "; choose others with --frames"));
  return files;
}

/// The images of a folder whose frames others replace; none if they cannot be read.
std::vector<FrameFile> replaced_images(const fs::path& images, const fs::path& root,
                                       const ReadOptions& options, Recording& recording) {
  Recording found = recording;
  try {
    std::vector<FrameFile> files = timed_images(images, root, options, found);
    recording = std::move(found);
    return files;
  } catch (const DataError&) {
    return {};
  }
}

/// The first line is "format …"; other files of this name are the user's notes.
bool is_described(const fs::path& folder) {
  return is_file(folder / kDescription) &&
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
  if (options.frames.empty() && is_file(camera))
    recording.calibrations = {{"camera_info.yaml", read_file(camera)}};
  if (offset_us == 0) return;
  move(offset_us, recording.triggers);
  if (contents.read_events) contents.read_events = moved(contents.read_events, offset_us);
}

/// Warns of files of events beside the one that is read.
void warn_of_other_events(const fs::path& folder, const fs::path& read, Recording& recording) {
  std::vector<std::string> others;
  for (const char* name : kEventNames) {
    if (folder / name != read && is_file(folder / name)) others.emplace_back(name);
  }
  for (const fs::path& path : event_files_in(folder, "events")) {
    const std::string name = path.filename().string();
    if (path != read && std::find(others.begin(), others.end(), name) == others.end())
      others.push_back(name);
  }
  if (others.empty()) return;
  recording.warnings.push_back(concat(
      folder.string(), ": expected one file of events, found ", listing(others), " beside ",
      read.lexically_relative(folder).string(), ", which is read; remove those that do not count"));
}

/// Calibrations in the folder of the recording, the preferred one first.
std::vector<CalibrationFile> find_calibrations(const fs::path& folder) {
  std::vector<CalibrationFile> out;
  for (const char* name : {"camchain.yaml", "calibration.yaml", "calib.txt"}) {
    if (is_file(folder / name)) out.push_back({name, read_file(folder / name)});
  }
  return out;
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
  for (const char* name : {"timestamps.npz", "exposures.csv"}) {
    for (const char* images : {"images_1", "images", ""}) {
      if (is_file(folder / images / name)) return true;
    }
  }
  return false;
}

std::vector<std::string> unfound_events(const fs::path& folder) {
  std::vector<std::string> out;
  std::error_code error;
  for (const fs::path& where : {folder, folder / "events", folder / "events_left"}) {
    for (const fs::path& path : event_files_in(where, "")) {
      out.push_back(path.lexically_relative(folder).string());
    }
  }
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name[0] != '.' && has_ending_of(in_small_letters(name), {".aedat", ".aedat4", ".bag",
                                                                 ".mcap", ".db3", ".dat", ".zip"}))
      out.push_back(name);
  }
  std::sort(out.begin(), out.end());
  return out;
}

std::vector<std::string> packed_files(const fs::path& folder) {
  std::vector<std::string> out;
  const fs::path read = events_in(folder);
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path& path = entry->path();
    std::error_code ignored;
    if (path.filename().string()[0] == '.' || !entry->is_regular_file(ignored)) continue;
    const fs::path kind = path.extension();
    const bool is_read = path == read;
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
    const bool packed = entry->path().extension() == ".zstd";  // compression_mode FILE
    const auto kind = (packed ? entry->path().stem() : entry->path()).extension();
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
  recording.calibrations = find_calibrations(folder);
  std::vector<fs::path> places = images_in(folder);
  const fs::path events = events_in(folder);
  const auto first = [&] { return places.empty() ? fs::path() : places.front(); };
  out.files = options.frames.empty() ? images_with_times(places, folder, events, options, recording)
                                     : replaced_images(first(), folder, options, recording);
  const fs::path images = first();
  if (out.files.empty() && options.frames.empty()) warn_of_no_images(folder, recording);
  const auto others = events.empty() ? unfound_events(folder) : std::vector<std::string>();
  if (!others.empty()) {
    recording.warnings.push_back(
        concat(folder.string(), ": expected one file of events, found ", listing(others),
               "; give that of the events: ", (folder / others.front()).string(), " --frames ",
               (images.empty() ? folder : images).string()));
  }
  if (!events.empty()) {
    // With frames of another source, the offset refers to their clock, not to this folder's. Lists
    // in text may have a clock of their own, which the import finds.
    const int64_t ahead_us = options.frames.empty() ? options.near_frames_ahead_us.value_or(0) : 0;
    const auto exposures = is_text(events) ? std::nullopt : span_of(out.files, ahead_us);
    out.read_events = events_of(events, options, exposures, recording);
    warn_of_other_events(folder, events, recording);
  }
  note_right_camera(folder, {options.frames.empty() ? images : fs::path(), events}, recording);
  if (described) describe(folder, options, out);
  return out;
}

}  // namespace jade::recording
