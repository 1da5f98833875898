// SPDX-License-Identifier: Apache-2.0
#include "jade_inspect/recording.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <torch/types.h>
#include <vector>

#include "common/shell.h"
#include "jade/core/error.h"
#include "jade/core/readable.h"
#include "jade/import/calibration.h"
#include "jade/import/frame_masks.h"
#include "jade/import/read_capture.h"
#include "jade/recording/recording.h"

namespace jade::apps {
namespace {

namespace fs = std::filesystem;
using recording::Recording;

/// Maximum number of events to examine: a gigabyte of memory with all derived data.
constexpr int64_t kMostEvents = int64_t(1) << 25;

/// Statistics of a recording.
struct RecordingNumbers {
  double first_s = 0, last_s = 0;  ///< of the events
  int64_t events = 0;
  double rate_hz = 0;                                     ///< events per second
  double positive = 0;                                    ///< share of the examined events
  double shortest_ms = 0, median_ms = 0, longest_ms = 0;  ///< exposures of a known length
  size_t exposed = 0;                                     ///< frames with a known exposure
  double frame_rate_hz = 0;
  std::string choice;  ///< flags that select among several event streams
};

RecordingNumbers numbers_of(const Recording& r) {
  RecordingNumbers n;
  if (!r.events.empty()) {
    const bool all = r.stored_events <= kMostEvents;
    n.events = all ? r.events.size() : r.stored_events;
    n.first_s = 1e-6 * double(r.events.first_us());
    n.last_s = 1e-6 * double(all ? r.events.last_us() : r.stored_us.end_us);
    n.rate_hz = double(n.events) / std::max(n.last_s - n.first_s, 1e-6);
    n.positive = (r.events.polarity() > 0).sum().item<double>() / double(r.events.size());
  }
  std::vector<double> lengths;
  for (const recording::Frame& frame : r.frames) {
    if (frame.t_end_us > frame.t_start_us)
      lengths.push_back(1e-3 * double(frame.t_end_us - frame.t_start_us));
  }
  std::sort(lengths.begin(), lengths.end());
  n.exposed = lengths.size();
  if (!lengths.empty()) {
    n.shortest_ms = lengths.front(), n.longest_ms = lengths.back();
    n.median_ms = lengths[lengths.size() / 2];
  }
  if (r.frames.size() > 1) {
    const double span = 1e-6 * double(r.frames.back().t_start_us - r.frames.front().t_start_us);
    n.frame_rate_hz = span > 0 ? double(r.frames.size() - 1) / span : 0;
  }
  return n;
}

/// Name of a file or folder, even if given as "scene/" or ".", without its endings.
fs::path name_of(const fs::path& path) {
  const fs::path whole = fs::absolute(path).lexically_normal();
  const fs::path name = whole.has_filename() ? whole : whole.parent_path();
  return name.extension() == ".gz" ? name.stem().stem() : name.stem();
}

/// Command to run next; missing parts are placeholders in capitals.
/// @param import_program  the command of jade_import
std::string next_command(const Recording& r, const RecordingNumbers& n,
                         const std::string& import_program) {
  if (r.events.empty()) return "";
  std::string line = import_program + " " + shell_word(r.source) + n.choice;
  if (r.frames.empty() && r.untimed_frames > 0) {
    line += " --frame-times LIST.csv";
  } else if (r.frames.empty()) {
    line += " --frames FOLDER_OR_VIDEO";
    if (r.triggers.rising_us.empty()) line += " --frame-times LIST.csv";
  } else if (n.exposed > 0 && n.exposed < r.frames.size()) {
    // jade_import measures the length if no frame has one.
    line += " --exposure-ms MILLISECONDS";
  }
  if (r.calibrations.empty()) line += " --calibration CAMERA.yaml";
  const bool two_cameras =
      !r.calibrations.empty() && r.calibrations.front().text.find("cam1:") != std::string::npos;
  if (two_cameras) line += " --plane-depth METRES";
  const fs::path output = fs::path("data") / name_of(r.source);
  return line + " --output " + shell_word(folder_apart(output, r.source));
}

/// Why a calibration that can be read does not fit the frames or the event sensor, if the recording
/// says its size, or which of its cameras took the frames, if that is in doubt; empty if it fits.
std::string misfit_of(const fs::path& path, const Recording& r) {
  try {
    import::Calibration calibration = import::read_calibration(path);
    std::string order;
    const bool is_rig = calibration.second_from_first.has_value();
    if (!r.frames.empty()) {
      const torch::Tensor& image = r.frames.front().image;
      order = import::put_frames_first(calibration, image.size(2), image.size(1));
      import::camera_of(calibration, 0, image.size(2), image.size(1), "frames");
    }
    if (r.width > 0 && r.size_is_said)
      import::camera_of(calibration, is_rig ? 1 : 0, r.width, r.height, "events");
    return order;
  } catch (const DataError& error) {
    return error.what();
  }
}

/// Leaves out calibrations of a folder that cannot be read, with a warning, and warns of one that
/// does not fit.
void check_calibrations(Recording& r) {
  while (!r.calibrations.empty() && fs::is_directory(r.source)) {
    const fs::path path = r.source / r.calibrations.front().name;
    if (!fs::exists(path)) return;  // of a bag, not of a folder
    const std::string fault = import::calibration_fault(path);
    if (fault.empty()) {
      if (std::string misfit = misfit_of(path, r); !misfit.empty())
        r.warnings.push_back(std::move(misfit));
      return;
    }
    r.warnings.push_back(concat(path.string(), fault, "; it is not used"));
    r.calibrations.erase(r.calibrations.begin());
  }
}

/// Reads the masks stored with the frames as jade_import does, and notes their statistics.
void note_masks(Recording& r) {
  const std::vector<torch::Tensor> masks = import::masks_of(r, r.notes);
  const auto masked = std::count_if(masks.begin(), masks.end(),
                                    [](const torch::Tensor& mask) { return mask.defined(); });
  if (masked == 0) return;
  r.notes.push_back(concat("masks exclude pixels of ", masked, " of ", masks.size(),
                           " frames; jade_import takes them along"));
}

/// Warns of too few frames for an import.
void check_count(Recording& r) {
  const size_t count = r.frames.size();
  if (count == 0 || count >= import::kFewestFrames) return;
  r.warnings.push_back(concat("expected at least ", import::kFewestFrames,
                              " frames from different places, found ", count,
                              "; jade_import refuses fewer: record again"));
}

void print_frames(const Recording& r, const RecordingNumbers& n) {
  if (r.frames.empty()) {
    std::printf("frames      none\n");
    return;
  }
  const torch::Tensor& image = r.frames.front().image;
  std::printf("frames      %zu of %ldx%ld px, %.3g a second\n", r.frames.size(),
              long(image.size(2)), long(image.size(1)), n.frame_rate_hz);
  if (n.exposed == 0) {
    std::printf("exposures   of unknown length; the time of a frame is taken as its %s\n",
                word_of(r.stamp));
  } else {
    std::printf("exposures   %zu, %.4g to %.4g ms, median %.4g\n", n.exposed, n.shortest_ms,
                n.longest_ms, n.median_ms);
  }
}

void print_recording(const Recording& r, const RecordingNumbers& n, const std::string& next) {
  std::printf("recording   %s, %s\n", r.source.c_str(), r.format.c_str());
  if (r.width > 0) {
    std::printf("sensor      %ldx%ld px\n", long(r.width), long(r.height));
  } else {
    std::printf("sensor      of unknown size\n");
  }
  if (r.events.empty()) {
    std::printf("events      none\n");
  } else {
    // The count has no separators, which scripts would have to remove.
    std::printf("events      %ld from %.6f to %.6f s (%.4g s), %s events/s, %.1f %% positive\n",
                long(n.events), n.first_s, n.last_s, n.last_s - n.first_s,
                grouped(std::llround(n.rate_hz)).c_str(), 100 * n.positive);
  }
  print_frames(r, n);
  if (!r.triggers.rising_us.empty() || !r.triggers.falling_us.empty()) {
    std::printf("triggers    %zu rising and %zu falling edges\n", r.triggers.rising_us.size(),
                r.triggers.falling_us.size());
  }
  if (!r.calibrations.empty()) std::printf("calibration %s\n", r.calibrations.front().name.c_str());
  std::printf("poses       none: a recording, no data set yet\n");
  if (!r.notes.empty() || !r.warnings.empty()) std::printf("\n");
  for (const std::string& warning : r.warnings) std::printf("warning     %s\n", warning.c_str());
  for (const std::string& note : r.notes) std::printf("note        %s\n", note.c_str());
  if (!next.empty()) std::printf("\nnext        %s\n", next.c_str());
}

nlohmann::json to_json(const Recording& r, const RecordingNumbers& n, const std::string& next) {
  nlohmann::json frames = nlohmann::json::array();
  for (const recording::Frame& frame : r.frames) {
    frames.push_back(
        {{"name", frame.name}, {"t_start_us", frame.t_start_us}, {"t_end_us", frame.t_end_us}});
  }
  nlohmann::json size;
  if (!r.frames.empty()) size = {r.frames.front().image.size(2), r.frames.front().image.size(1)};
  return {{"recording", r.source.string()},
          {"format", r.format},
          {"width", r.width},
          {"height", r.height},
          {"events", n.events},
          {"first_s", n.first_s},
          {"last_s", n.last_s},
          {"events_per_second", n.rate_hz},
          {"positive_share", n.positive},
          {"frame_size", size},
          {"frames", frames},
          {"stamp", word_of(r.stamp)},
          {"rising_us", r.triggers.rising_us},
          {"falling_us", r.triggers.falling_us},
          {"calibration", r.calibrations.empty() ? "" : r.calibrations.front().name},
          {"notes", r.notes},
          {"warnings", r.warnings},
          {"next", next}};
}

}  // namespace

void inspect_recording(const fs::path& path, recording::ReadOptions options,
                       const std::string& import_program, bool json) {
  options.most_events = kMostEvents;
  Recording r = recording::read_recording(path, options);
  check_calibrations(r);
  note_masks(r);
  check_count(r);
  RecordingNumbers numbers = numbers_of(r);
  if (!options.events_group.empty())
    numbers.choice += " --events-group " + shell_word(options.events_group);
  if (!options.topic.empty()) numbers.choice += " --topic " + shell_word(options.topic);
  if (!options.frames_topic.empty())
    numbers.choice += " --frames-topic " + shell_word(options.frames_topic);
  const std::string next = next_command(r, numbers, import_program);
  if (json) {
    // File names are arbitrary bytes, those in JSON are UTF-8.
    constexpr auto kReplace = nlohmann::json::error_handler_t::replace;
    std::printf("%s\n", to_json(r, numbers, next).dump(2, ' ', false, kReplace).c_str());
  } else {
    print_recording(r, numbers, next);
  }
}

}  // namespace jade::apps
