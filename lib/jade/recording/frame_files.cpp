// SPDX-License-Identifier: Apache-2.0
#include <ATen/Parallel.h>
#include <algorithm>
#include <map>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

/// The first image says how large all of them will be.
void check_memory(const std::vector<FrameFile>& files, const Frame& first) {
  events::check_memory(concat(files.front().path.parent_path().string(), ": ", files.size(),
                              " frames of ", first.image.size(2), "x", first.image.size(1), " px"),
                       double(files.size()) * double(first.image.nbytes()));
}

Frame read_frame(const FrameFile& file) {
  return {file.path.stem().string(), imaging::read_image(file.path), file.time->begin_us,
          file.time->end_us};
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

}  // namespace

void apply_exposures(const fs::path& list, const std::vector<NamedExposure>& exposures,
                     std::vector<FrameFile>& files) {
  std::map<std::string, events::TimeWindow> by_name;
  for (const NamedExposure& row : exposures) {
    const std::string name = fs::path(row.name).filename().string();
    by_name[name] = {row.start_us, row.end_us};
  }
  for (FrameFile& file : files) {
    auto found = by_name.find(file.path.filename().string());
    if (found == by_name.end()) found = by_name.find(file.path.stem().string());
    if (found == by_name.end()) {
      throw DataError(concat(list.string(), ": expected a line for ", file.path.filename().string(),
                             ", found none among ", exposures.size(), "; add it"));
    }
    file.time = found->second;
  }
}

void read_frames(std::vector<FrameFile> files, Recording& recording) {
  const auto untimed = std::stable_partition(files.begin(), files.end(),
                                             [](const FrameFile& f) { return f.time.has_value(); });
  if (untimed != files.end()) {
    recording.untimed_frames = files.end() - untimed;
    recording.notes.push_back(concat(recording.untimed_frames, " of ", files.size(),
                                     " frames have no time and are left out; give them one with "
                                     "--frame-times LIST.csv (name,start_us,end_us)"));
    files.erase(untimed, files.end());
  }
  std::stable_sort(files.begin(), files.end(), [](const FrameFile& a, const FrameFile& b) {
    return a.time->begin_us < b.time->begin_us;
  });
  if (files.empty()) return;
  std::vector<Frame> frames(files.size());
  frames[0] = read_frame(files[0]);
  check_memory(files, frames[0]);
  at::parallel_for(1, int64_t(files.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) frames[size_t(i)] = read_frame(files[size_t(i)]);
  });
  check_one_size(files, frames);
  recording.frames = std::move(frames);
}

}  // namespace jade::recording
