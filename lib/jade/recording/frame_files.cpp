// SPDX-License-Identifier: Apache-2.0
#include <ATen/Parallel.h>
#include <algorithm>
#include <cctype>
#include <map>
#include <set>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/median.h"
#include "jade/core/text.h"
#include "jade/events/stream_faults.h"
#include "jade/events/time_unit.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/range.h"
#include "jade/io/accents.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

/// Uses the first image's size for all.
void check_memory(const std::vector<FrameFile>& files, const Frame& first) {
  events::check_memory(concat(files.front().path.parent_path().string(), ": ", files.size(),
                              " frames of ", first.image.size(2), "x", first.image.size(1), " px"),
                       double(files.size()) * double(first.image.nbytes()));
}

/// @param fault  as of read_image()
Frame read_frame(const FrameFile& file, std::string& fault) {
  return {file.path.stem().string(), imaging::read_image(file.path, &fault), file.time->begin_us,
          file.time->end_us, file.path};
}

void check_one_size(const std::vector<FrameFile>& files, const std::vector<Frame>& frames) {
  for (size_t i = 1; i < frames.size(); ++i) {
    const auto size = frames[i].image.sizes(), first = frames[0].image.sizes();
    if (size == first) continue;
    throw DataError(concat(files[i].path.string(), ": is ", size[2], "x", size[1], " while ",
                           files[0].path.filename().string(), " is ", first[2], "x", first[1],
                           "; all frames must have one size"));
  }
}

std::string name_of(const FrameFile& file) { return file.path.filename().string(); }

/// Warns of lines of a list that match no image.
void warn_of_unused(const fs::path& list, const std::vector<NamedExposure>& exposures,
                    const std::set<const NamedExposure*>& used,
                    std::vector<std::string>& warnings) {
  if (used.size() == exposures.size()) return;
  const auto first = std::find_if(exposures.begin(), exposures.end(),
                                  [&](const NamedExposure& row) { return used.count(&row) == 0; });
  warnings.push_back(concat(list.string(), ": ", exposures.size() - used.size(), " of ",
                            exposures.size(), " exposures name a frame that is not there (",
                            first->name, "); add the frames or remove the lines"));
}

/// How well the folders of a listed name agree with a frame's: two per equal folder, counted from
/// the file, and one more if all folders of the name are equal.
int agreement(const fs::path& listed, const fs::path& frame) {
  const fs::path a = listed.parent_path(), b = frame.parent_path();
  const std::vector<fs::path> wanted(a.begin(), a.end()), known(b.begin(), b.end());
  const auto ends = std::mismatch(wanted.rbegin(), wanted.rend(), known.rbegin(), known.rend());
  return int(2 * (ends.first - wanted.rbegin())) + (ends.first == wanted.rend() ? 1 : 0);
}

using Rows = std::vector<const NamedExposure*>;

/// File name with its ending in small letters, as cameras and lists differ in them: "a.PNG",
/// "a.png".
std::string key_of(const fs::path& path) {
  return path.stem().string() + in_small_letters(path.extension().string());
}

/// The line of a frame among those with its file name, which lists of several cameras repeat.
/// @throws DataError if the folders do not say which of two different lines is the frame's.
const NamedExposure& line_of(const fs::path& frame, const Rows& rows, const fs::path& list) {
  const fs::path whole = fs::absolute(frame).lexically_normal();
  const NamedExposure* best = rows.front();
  const NamedExposure* rival = nullptr;
  for (const NamedExposure* row : rows) {
    const int here = agreement(row->name, whole), there = agreement(best->name, whole);
    const bool differs = row->start_us != best->start_us || row->end_us != best->end_us;
    if (here > there) best = row, rival = nullptr;
    if (here == there && differs) rival = row;
  }
  if (rival == nullptr) return *best;
  throw DataError(concat(list.string(), ": expected one line for ", frame.filename().string(),
                         ", found ", best->name, " and ", rival->name,
                         " with different times; keep the lines of the frames' camera"));
}

/// Warns of exposures that are too short for µs, as lengths in ms are: at most a thousandth of the
/// frame period. @throws DataError for exposures that are too long.
void check_lengths(const fs::path& list, const std::vector<events::NamedWindow>& exposed,
                   std::vector<std::string>& warnings) {
  constexpr double kUsPerMs = 1000;
  std::vector<int64_t> lengths;
  for (const events::NamedWindow& each : exposed) lengths.push_back(each.window.duration_us());
  const auto length_us = double(median_of(std::move(lengths)));
  const auto period_us = double(events::frame_period_us(exposed));
  if (kUsPerMs * length_us <= period_us) {
    warnings.push_back(concat(list.string(), ": expected exposures in us, found ", length_us,
                              " us as the median length, at a frame period of ",
                              period_us / kUsPerMs,
                              " ms; if the lengths are in milliseconds, multiply them by 1000"));
  }
  if (!events::is_too_slow(length_us, period_us)) return;
  throw DataError(concat(list.string(), ": expected exposures in whole us, found ",
                         1e-6 * length_us, " s as the median length, at a frame period of ",
                         1e-6 * period_us,
                         " s; if the times are in nanoseconds, divide them by 1000"));
}

}  // namespace

void note_respelled(const fs::path& list, const std::vector<std::string>& names,
                    std::vector<std::string>& notes) {
  if (names.empty()) return;
  notes.push_back(concat(list.string(), ": ", names.size(), " names, such as ", names.front(),
                         ", have accents in another form than the files (one letter, or a letter ",
                         "and a mark, as macOS writes them); the files that look alike are used"));
}

void apply_exposures(const fs::path& list, const std::vector<NamedExposure>& exposures,
                     std::vector<FrameFile>& files, Recording& recording) {
  std::map<std::string, Rows> by_name;
  for (const NamedExposure& row : exposures) {
    by_name[key_of(row.name)].push_back(&row);
  }
  std::set<const NamedExposure*> used;
  std::vector<std::string> respelled;
  for (FrameFile& file : files) {
    auto found = by_name.find(key_of(file.path));
    if (found == by_name.end()) found = by_name.find(file.path.stem().string());
    if (found == by_name.end()) {
      found = std::find_if(by_name.begin(), by_name.end(), [&](const auto& row) {
        return io::same_but_accents(row.first, key_of(file.path)) ||
               io::same_but_accents(row.first, file.path.stem().string());
      });
      if (found != by_name.end()) respelled.push_back(found->first);
    }
    if (found == by_name.end()) {
      throw DataError(concat(list.string(), ": expected a line for ", file.path.filename().string(),
                             ", found none among ", exposures.size(),
                             exposures.empty() ? "" : concat(" such as '", exposures[0].name, "'"),
                             "; add it"));
    }
    const NamedExposure& row = line_of(file.path, found->second, list);
    file.time = events::TimeWindow{row.start_us, row.end_us};
    used.insert(&row);
  }
  note_respelled(list, respelled, recording.notes);
  warn_of_unused(list, exposures, used, recording.warnings);
  check_apart(list, files, recording);
}

void check_apart(const fs::path& list, const std::vector<FrameFile>& files, Recording& recording) {
  std::vector<events::NamedWindow> exposed;
  for (const FrameFile& file : files) {
    if (file.time && file.time->duration_us() > 0) exposed.push_back({name_of(file), *file.time});
  }
  if (exposed.size() < 2) return;
  // Frames without stamps have a message of their own.
  if (std::all_of(exposed.begin(), exposed.end(),
                  [](const events::NamedWindow& each) { return may_lack_stamp(each.window); }))
    return;
  check_lengths(list, exposed, recording.warnings);
  const std::string fault = events::overlap_fault(list.string(), std::move(exposed));
  if (!fault.empty()) recording.warnings.push_back(fault);
}

std::optional<events::TimeWindow> span_of(const std::vector<FrameFile>& files, int64_t ahead_us) {
  std::optional<events::TimeWindow> out;
  for (const FrameFile& file : files) {
    if (!file.time) continue;
    if (!out) out = file.time;
    out->begin_us = std::min(out->begin_us, file.time->begin_us);
    out->end_us = std::max(out->end_us, file.time->end_us);
  }
  if (out) out = {out->begin_us + ahead_us, out->end_us + ahead_us};
  return out;
}

void read_frames(std::vector<FrameFile> files, Recording& recording) {
  const auto untimed = std::stable_partition(files.begin(), files.end(),
                                             [](const FrameFile& f) { return f.time.has_value(); });
  if (untimed != files.end()) {
    recording.untimed_frames = files.end() - untimed;
    // Without any time, the import says so in its error.
    auto& where = untimed == files.begin() ? recording.notes : recording.warnings;
    where.push_back(concat(recording.untimed_frames, " of ", files.size(),
                           " frames have no time and are left out; give them one with "
                           "--frame-times LIST.csv (name,start_us,end_us)"));
    files.erase(untimed, files.end());
  }
  std::stable_sort(files.begin(), files.end(), [](const FrameFile& a, const FrameFile& b) {
    return a.time->begin_us < b.time->begin_us;
  });
  if (files.empty()) return;
  std::vector<Frame> frames(files.size());
  std::vector<std::string> faults(files.size());
  frames[0] = read_frame(files[0], faults[0]);
  check_memory(files, frames[0]);
  at::parallel_for(1, int64_t(files.size()), 1, [&](int64_t begin, int64_t end) {
    for (auto i = size_t(begin); i < size_t(end); ++i) frames[i] = read_frame(files[i], faults[i]);
  });
  if (const std::string fault = imaging::fault_of_all(faults); !fault.empty())
    recording.warnings.push_back(fault);
  check_one_size(files, frames);
  std::vector<torch::Tensor> images;
  std::vector<std::string> names;
  for (const Frame& frame : frames) {
    images.push_back(frame.image);
    names.push_back(frame.name);
  }
  for (const std::string& fault : imaging::frame_faults(images, names)) {
    recording.warnings.push_back(fault);
  }
  recording.frames = std::move(frames);
}

}  // namespace jade::recording
