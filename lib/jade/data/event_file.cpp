// SPDX-License-Identifier: Apache-2.0
#include "jade/data/event_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <future>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/data/named_files.h"
#include "jade/events/event_files.h"
#include "jade/events/pixels.h"
#include "jade/events/stream_faults.h"
#include "jade/imaging/event_cover.h"
#include "jade/io/hdf5.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// Recordings usually start a little before the first pose and end after the last one; warn if a
/// larger share of the events lies outside.
constexpr double kManyOutside = 0.1;

/// Largest share of events outside the image. Raw whole-pixel coordinates allow none; rectified
/// ones leave the image at its borders, and more of them if the image is a crop of the sensor.
constexpr double kManyBeside = 0.25;

/// True if no coordinate among the first events has a fraction.
bool whole_pixels(const events::EventStream& events) {
  const events::EventStream some = events.range(0, std::min<int64_t>(events.size(), 100000));
  return torch::equal(some.x(), some.x().round()) && torch::equal(some.y(), some.y().round());
}

void check_inside(const events::EventStream& events, const geometry::Intrinsics& camera,
                  const fs::path& path, const Warnings& warnings) {
  if (events.empty()) return;
  const int64_t outside = events::count_problems(events, {camera.height, camera.width}).outside;
  const double share = double(outside) / double(events.size());
  if (outside == 0 || (share < kManyBeside && !whole_pixels(events))) return;
  warnings.add(path.string(), ": ", outside, " of ", events.size(), " events lie outside the ",
               camera.width, "x", camera.height,
               " image and are ignored; if that is not meant, x and y may be swapped, or belong to "
               "another resolution or to the raw sensor");
}

events::EventStream cut(const events::EventStream& events, const EventSpan& keep,
                        const fs::path& path, const Warnings& warnings) {
  if (keep.end_us == INT64_MAX || events.empty()) return events;
  events::EventStream kept = events.slice(keep.begin_us, keep.end_us + 1);
  const int64_t dropped = events.size() - kept.size();
  if (double(dropped) > kManyOutside * double(events.size())) {
    warnings.add(path.string(), ": ", dropped, " of ", events.size(),
                 " events lie outside the recording's poses [", keep.begin_us, ", ", keep.end_us,
                 "] us and were dropped; check dataset.events_unit and all_timestamps.npy");
  }
  return kept;
}

/// Checks memory before an HDF5 file is read: its longest array in addition to the loaded frames.
void check_room(const fs::path& path, const Dataset& data) {
  constexpr double kBytesPerEvent = 17;
  if (path.extension() != ".h5" && path.extension() != ".hdf5") return;
  int64_t count = 0;
  const io::Hdf5File file(path);
  for (const io::Hdf5Dataset& list : file.datasets()) {
    for (const int64_t length : list.shape) count = std::max(count, length);
  }
  double frames = 0;
  for (const Exposure& exposure : data.train) frames += double(exposure.blurry.nbytes());
  for (const SharpView& view : data.test) frames += double(view.image.nbytes());
  events::check_memory(concat(path.string(), ": ", count, " events and ",
                              data.train.size() + data.test.size(), " frames"),
                       kBytesPerEvent * double(count) + frames,
                       "use a shorter recording, or smaller frames");
}

}  // namespace

fs::path find_event_file(const DatasetOptions& options) {
  if (!options.events_file.empty()) {
    check_link(options.events_file);
    if (fs::is_regular_file(options.events_file)) return options.events_file;
    if (fs::is_directory(options.events_file)) {
      throw DataError(concat(options.events_file.string(), ": expected one file of events, found ",
                             "a folder; give one of its files, or convert them to one ",
                             "events.h5 with x, y, t and p"));
    }
    throw DataError(concat(options.events_file.string(),
                           ": no such file; dataset.events_file must be a recording of events"));
  }
  for (const char* name : {"events.h5", "events.hdf5", "events/events.h5", "events.npz",
                           "events.npy", "events.txt", "events.csv"}) {
    const fs::path path = options.path / name;
    check_link(path);
    if (fs::is_regular_file(path)) return path;
  }
  return {};
}

namespace {

/// "; found events.txt.gz, events/ , not read", for entries named like events; else empty.
std::string unread_events(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    const std::string name = entry->path().filename().string();
    if (in_small_letters(name).rfind("event", 0) != 0) continue;
    names.push_back(name + (entry->is_directory(ignored) ? "/ (a folder)" : ""));
  }
  if (names.empty()) return "";
  std::sort(names.begin(), names.end());
  return concat("; found ", listing(names, 4),
                ", not read: unpack it, or convert it to one events.h5 with x, y, t and p");
}

/// How far the camera moves from one time to another: as an angle, at the depth of the scene.
double motion(const Dataset& data, double from_us, double to_us) {
  const geometry::Pose a = data.trajectory.at(from_us), b = data.trajectory.at(to_us);
  const geometry::Vector3 p = geometry::centre(a), q = geometry::centre(b);
  return geometry::rotation_angle(a, b) +
         std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]) / std::sqrt(data.near * data.far);
}

/// True if the camera rests in the window and moves before or after it, by the path.
bool rests(const Dataset& data, const events::TimeWindow& window) {
  constexpr double kStill = 0.2;  // of the motion beside it
  if (data.trajectory.empty()) return false;
  const double begin = double(window.begin_us), end = double(window.end_us);
  const double beside =
      std::max(motion(data, 2 * begin - end, begin), motion(data, end, 2 * end - begin));
  return motion(data, begin, end) < kStill * beside;
}

/// A line about stretches without events in exposures, as lost packets leave them; else empty.
std::string silence_fault(const Dataset& data) {
  std::vector<events::TimeWindow> silences = events::silences(data.events);
  silences.erase(std::remove_if(silences.begin(), silences.end(),
                                [&](const auto& silence) { return rests(data, silence); }),
                 silences.end());
  std::vector<events::NamedWindow> exposures;
  for (const Exposure& exposure : data.train) {
    exposures.push_back({exposure.name, {exposure.t_start_us, exposure.t_end_us}});
  }
  const std::string fault = events::silence_fault(exposures, silences);
  if (fault.empty()) return "";
  return fault + "; restorations are wrong there; record again, or leave these frames out";
}

}  // namespace

void attach_events(const DatasetOptions& options, const EventSpan& exposures, const EventSpan& keep,
                   const Warnings& warnings, Dataset& data) {
  const fs::path path = find_event_file(options);
  if (path.empty()) {
    warnings.add(options.path.string(),
                 ": no recording of events (events.h5); only the frames are "
                 "used, set dataset.events_file if there is one",
                 unread_events(options.path));
    return;
  }
  check_room(path, data);
  const geometry::Intrinsics& camera = data.train.front().camera;
  events::EventFileOptions file_options;
  file_options.time_unit = options.events_unit;
  file_options.exposures = events::TimeWindow{exposures.begin_us, exposures.end_us};
  events::EventFileResult result = events::read_events(path, file_options);
  for (const std::string& line : result.warnings) warnings.add(line);
  data.events = cut(result.events, keep, path, warnings);
  std::array<std::future<std::string>, 5> faults{
      std::async(std::launch::async, [&] { return events::place_fault(result.events); }),
      std::async(std::launch::async, [&] { return events::polarity_fault(result.events); }),
      std::async(std::launch::async, [&] { return events::resolution_fault(result.events); }),
      std::async(std::launch::async,
                 [&] {
                   return imaging::cover_fault(result.events,
                                               data.train[data.train.size() / 2].blurry);
                 }),
      std::async(std::launch::async, [&] { return silence_fault(data); })};
  check_inside(result.events, camera, path, warnings);
  for (std::future<std::string>& check : faults) {
    const std::string fault = check.get();
    if (!fault.empty()) warnings.add(path.string(), ": ", fault);
  }
  std::vector<std::string> without;
  for (Exposure& exposure : data.train) {
    exposure.events = data.events.slice(exposure.t_start_us, exposure.t_end_us);
    if (exposure.events.empty()) without.push_back(exposure.name);
  }
  if (without.empty()) return;
  warnings.add(path.string(), ": ", without.size(), " of ", data.train.size(),
               " exposures have no events (", listing(without),
               "); there the frame itself is taken as sharp. Is the recording complete, and "
               "dataset.events_unit right?");
}

void tell_hot_pixel(const Dataset& data, const Warnings& warnings) {
  constexpr int64_t kFewestEvents = 1000, kFewestPixels = 200;
  constexpr double kLargestShare = 0.05, kTimesOthers = 100;
  if (data.train.empty() || data.events.size() < kFewestEvents) return;
  const int64_t width = data.train.front().camera.width, height = data.train.front().camera.height;
  if (width * height < kFewestPixels) return;
  const torch::Tensor image = events::pixel_counts(data.events, {height, width});
  const int64_t* const first = image.const_data_ptr<int64_t>();
  std::vector<int64_t> counts(first, first + image.numel());
  const auto highest = std::max_element(counts.begin(), counts.end());
  const int64_t most = *highest, at = highest - counts.begin();
  const auto quantile = counts.begin() + std::ptrdiff_t(counts.size() * 999 / 1000);
  std::nth_element(counts.begin(), quantile, counts.end());
  const double usual = std::max(1.0, double(*quantile));
  const double share = double(most) / double(data.events.size());
  if (share <= kLargestShare && double(most) <= kTimesOthers * usual) return;
  warnings.add(data.root.string(), ": pixel (", at % width, ", ", at / width, ") has ", most,
               " of ", data.events.size(), " events (", 0.1 * std::round(1000 * share),
               " %), as a hot pixel has; exclude it by an image that is black there: "
               "dataset.mask, or mask.png in the folder");
}

}  // namespace jade::data
