// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/recording.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/recording/contents.h"
#include "jade/recording/format.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

/// Events that reach this part of the frames in both directions are of the same sensor.
constexpr double kSameSensor = 0.9;

Contents read_contents(const fs::path& path, const ReadOptions& options) {
  switch (recognise(path)) {
    case Format::kEvt:
      return read_evt(path, options);
    case Format::kRpg:
      return read_rpg(path, options);
    case Format::kZip:
      return read_rpg_zip(path, options);
    case Format::kFrameFolder:
      return read_event_folder(path, options);
    case Format::kAedat4:
    case Format::kRosBag:
      return read_converted(path, options);
    case Format::kHdf5:
      return is_metavision(path) ? read_metavision(path) : read_event_file(path, options);
    case Format::kNpz:
    case Format::kNpy:
    case Format::kText:
      return read_event_file(path, options);
  }
  throw ContractError("recognise: a format without a reader");
}

void cut_to(const events::TimeWindow& window, Contents& contents) {
  Recording& recording = contents.recording;
  recording.events = recording.events.slice(window);
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

/// Frames of the event sensor itself tell its size.
void find_sensor_size(Recording& recording) {
  if (recording.width > 0 || recording.frames.empty() || recording.events.empty()) return;
  const torch::Tensor& image = recording.frames.front().image;
  const double width = double(image.size(2)), height = double(image.size(1));
  const double right = recording.events.x().max().item<double>() + 1;
  const double bottom = recording.events.y().max().item<double>() + 1;
  const bool inside = right <= width && bottom <= height;
  if (inside && right >= kSameSensor * width && bottom >= kSameSensor * height) {
    recording.width = image.size(2), recording.height = image.size(1);
    return;
  }
  recording.notes.push_back(concat("events lie within ", right, "x", bottom, " px, frames are ",
                                   width, "x", height,
                                   " px: two cameras, or few events; the size of the event sensor "
                                   "is not known"));
}

/// Keeps the events on the sensor; rectified ones between its pixels stay.
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
  recording.notes.push_back(concat(outside, " of ", all.size(), " events lie beside the ",
                                   recording.width, "x", recording.height,
                                   " sensor and were dropped"));
  recording.events = {all.x().masked_select(inside), all.y().masked_select(inside),
                      all.t_us().masked_select(inside), all.polarity().masked_select(inside)};
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

void note_clocks(Recording& recording) {
  const auto& frames = recording.frames;
  if (frames.empty() || recording.events.empty()) return;
  const int64_t first = recording.events.first_us(), last = recording.events.last_us();
  const auto covered = std::count_if(frames.begin(), frames.end(), [&](const Frame& f) {
    return f.t_end_us >= first && f.t_start_us <= last;
  });
  if (covered == int64_t(frames.size())) return;
  recording.notes.push_back(concat(frames.size() - size_t(covered), " of ", frames.size(),
                                   " frames lie outside the time of the ", "events (",
                                   1e-6 * double(first), " to ", 1e-6 * double(last), " s)",
                                   covered == 0 ? "; the two clocks may differ" : ""));
}

}  // namespace

Recording read_recording(const fs::path& path, const ReadOptions& options) {
  Contents contents = read_contents(path, options);
  Recording& recording = contents.recording;
  recording.source = path;
  if (!options.frames.empty()) replace_frames(options.frames, options, contents);
  complete_exposures(options, contents);
  if (options.window) cut_to(*options.window, contents);
  read_frames(std::move(contents.files), recording);
  find_sensor_size(recording);
  drop_outside(recording);
  if (recording.events.empty()) recording.notes.push_back("there are no events");
  note_frames(recording);
  note_clocks(recording);
  return std::move(recording);
}

}  // namespace jade::recording
