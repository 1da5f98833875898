// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/event_folder.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/io/npy.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;
using events::TimeUnit;

/// Exposures are between these, which tells the unit of their times.
constexpr double kShortest_us = 10, kLongest_us = 5e6;

fs::path events_in(const fs::path& folder) {
  for (const char* name : {"events.h5", "events.hdf5", "events/events.h5", "events.npz",
                           "events.npy", "events.csv", "events.raw"}) {
    if (fs::is_regular_file(folder / name)) return folder / name;
  }
  return {};
}

fs::path images_in(const fs::path& folder) {
  for (const char* name : {"images_1", "images"}) {
    if (fs::is_directory(folder / name) && !imaging::list_images(folder / name).empty())
      return folder / name;
  }
  return {};
}

/// A file that lies with the images, or beside their folder; empty if there is none.
fs::path beside_images(const fs::path& folder, const fs::path& images, const char* name) {
  for (const fs::path& path : {images / name, folder / name}) {
    if (fs::is_regular_file(path)) return path;
  }
  return {};
}

double microseconds(TimeUnit unit) {
  return unit == TimeUnit::kS ? 1e6 : unit == TimeUnit::kNs ? 1e-3 : 1;
}

/// As data sets have it: the unit in which the median exposure is plausible.
TimeUnit unit_of(const torch::Tensor& start, const torch::Tensor& end, const fs::path& path) {
  torch::Tensor lengths = (end - start).to(torch::kFloat64);
  lengths = lengths.masked_select(lengths > 0);
  if (lengths.numel() == 0) return start.is_floating_point() ? TimeUnit::kS : TimeUnit::kUs;
  const double median = lengths.median().item<double>();
  for (const TimeUnit unit : {TimeUnit::kUs, TimeUnit::kNs, TimeUnit::kS}) {
    if (unit == TimeUnit::kS && !start.is_floating_point()) continue;
    const double us = median * microseconds(unit);
    if (us >= kShortest_us && us <= kLongest_us) return unit;
  }
  throw DataError(concat(path.string(), ": the median exposure is ", median,
                         ", which is no plausible time in us, ns or s; give the unit"));
}

/// Exact for whole numbers, rounded to whole µs.
torch::Tensor whole_us(const torch::Tensor& times, TimeUnit unit, const fs::path& path) {
  if (!times.is_floating_point()) {
    const torch::Tensor t = times.to(torch::kInt64);
    return unit == TimeUnit::kNs ? t.div(1000, "floor") : unit == TimeUnit::kS ? t * 1000000 : t;
  }
  const torch::Tensor t = times.to(torch::kFloat64) * microseconds(unit);
  if (!(t.abs() < 4e18).all().item<bool>())
    throw DataError(
        concat(path.string(), ": expected finite times, found others; export it again"));
  return t.round().to(torch::kInt64);
}

std::optional<events::TimeWindow> span_of(const std::vector<FrameFile>& files) {
  std::optional<events::TimeWindow> out;
  for (const FrameFile& file : files) {
    if (!file.time) continue;
    if (!out) out = file.time;
    out->begin_us = std::min(out->begin_us, file.time->begin_us);
    out->end_us = std::max(out->end_us, file.time->end_us);
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
  const TimeUnit unit = wanted == TimeUnit::kAuto ? unit_of(start, end, path) : wanted;
  const torch::Tensor from = whole_us(start, unit, path), to = whole_us(end, unit, path);
  for (size_t i = 0; i < files.size(); ++i) {
    files[i].time = {from[int64_t(i)].item<int64_t>(), to[int64_t(i)].item<int64_t>()};
    if (files[i].time->duration_us() >= 0) continue;
    throw DataError(concat(path.string(), ": frame ", i,
                           " ends before its start; swap the two "
                           "arrays"));
  }
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

bool holds_bag(const fs::path& folder) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const auto kind = entry->path().extension();
    if (kind == ".db3" || kind == ".mcap") return true;
  }
  return false;
}

Contents read_event_folder(const fs::path& folder, const ReadOptions& options) {
  Contents out;
  Recording& recording = out.recording;
  recording.format = "folder of frames and events";
  recording.stamp = options.stamp.value_or(Stamp::kMiddle);
  const fs::path images = images_in(folder);
  if (!images.empty()) {
    for (const fs::path& file : imaging::list_images(images)) out.files.push_back({file, {}});
    if (const auto list = beside_images(folder, images, "exposures.csv"); !list.empty()) {
      apply_exposures(list, read_exposures(list), out.files);
    } else if (const auto npz = beside_images(folder, images, "timestamps.npz"); !npz.empty()) {
      add_npz_times(npz, options.time_unit, out.files, recording);
    }
  }
  const fs::path events = events_in(folder);
  if (!events.empty()) {
    out.read_events = events_of(events, options, span_of(out.files), recording);
  }
  return out;
}

}  // namespace jade::recording
