// SPDX-License-Identifier: Apache-2.0
// The exposures of a recording's frames: from the options, the trigger input or the frames' own
// times.
#include <algorithm>
#include <cmath>
#include <string>

#include "jade/core/error.h"
#include "jade/core/median.h"
#include "jade/core/text.h"
#include "jade/events/stream_faults.h"
#include "jade/io/zip.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

constexpr const char* kGiveTimes =
    "give a list \"name,start_us,end_us\" of their exposures, or record them with a trigger signal";

bool lacks_length(const FrameFile& file) { return !file.time || file.time->duration_us() == 0; }

/// The middle length of pulses, in ms.
std::string length_of(const std::vector<events::TimeWindow>& pulses) {
  std::vector<int64_t> lengths;
  lengths.reserve(pulses.size());
  for (const events::TimeWindow& pulse : pulses) lengths.push_back(pulse.duration_us());
  return concat(1e-3 * double(median_of(std::move(lengths))), " ms");
}

/// Counts pulses and edges of the trigger input: "3 pulses of 1 ms (3 rising, 4 falling edges)".
std::string said_of(const Triggers& triggers, const std::vector<events::TimeWindow>& pulses) {
  return concat(pulses.size(), " pulses", pulses.empty() ? "" : " of " + length_of(pulses), " (",
                triggers.rising_us.size(), " rising, ", triggers.falling_us.size(),
                " falling edges)");
}

/// One edge per frame: the starts of pulses or, without their ends, of one kind.
struct Edges {
  std::vector<int64_t> us;  ///< empty: there is not one per frame
  Stamp marks = Stamp::kStart;
};

Edges edges_per_frame(const std::vector<events::TimeWindow>& pulses, const Triggers& triggers,
                      TriggerLevel level, size_t frames) {
  const bool high = level == TriggerLevel::kHigh;
  const auto& starts = high ? triggers.rising_us : triggers.falling_us;
  const auto& ends = high ? triggers.falling_us : triggers.rising_us;
  if (pulses.size() == frames) {
    Edges out;
    for (const events::TimeWindow& pulse : pulses) out.us.push_back(pulse.begin_us);
    return out;
  }
  if (starts.size() == frames) return {starts, Stamp::kStart};
  if (ends.size() == frames) return {ends, Stamp::kEnd};
  return {};
}

/// Whether the times of frames, by another clock, follow the edges to half of the frame period.
bool follow(const std::vector<FrameFile>& files, const std::vector<int64_t>& edges_us) {
  if (files.size() < 2 || edges_us.size() != files.size()) return false;
  int64_t least = INT64_MAX, most = INT64_MIN;
  for (size_t i = 0; i < files.size(); ++i) {
    const int64_t apart = files[i].time->begin_us - edges_us[i];
    least = std::min(least, apart), most = std::max(most, apart);
  }
  const int64_t period_us = (edges_us.back() - edges_us.front()) / int64_t(files.size() - 1);
  return 2 * (most - least) <= period_us;
}

/// Warns of a signal with one pulse per frame at the other level than that of the options.
void check_level(const ReadOptions& options, size_t frames, Recording& recording) {
  const bool high = options.trigger_level == TriggerLevel::kHigh;
  const TriggerLevel other = high ? TriggerLevel::kLow : TriggerLevel::kHigh;
  const auto pulses = exposures_of(recording.triggers, other);
  if (pulses.size() != frames) return;
  recording.warnings.push_back(
      concat("expected one pulse of the trigger input per frame at the level ",
             word_of(options.trigger_level), ", found one per frame at the other: ", pulses.size(),
             " pulses of ", length_of(pulses), "; if the signal is inverted, give --trigger-level ",
             word_of(other)));
}

Triggers sorted(Triggers edges) {
  for (auto* const each : {&edges.rising_us, &edges.falling_us})
    std::sort(each->begin(), each->end());
  return edges;
}

/// Exchanges the triggers for those of another channel if only that has one pulse per frame.
void prefer_channel(const ReadOptions& options, size_t frames, Recording& recording) {
  const auto fits = [&](const Triggers& triggers) {
    return exposures_of(triggers, options.trigger_level).size() == frames;
  };
  if (frames == 0 || fits(recording.triggers)) return;
  for (const auto& [channel, triggers] : recording.other_triggers) {
    if (!fits(triggers)) continue;
    recording.triggers = triggers;
    recording.notes.push_back(concat("channel ", channel, " of the trigger input is used after ",
                                     "all, as it has one pulse per frame"));
    return;
  }
}

/// Uses the trigger input if it has one pulse, or one edge, per frame. A length that the user gives
/// replaces that of the pulses, as a strobe's pulse marks only a time.
void apply_triggers(const ReadOptions& options, Contents& contents) {
  auto& files = contents.files;
  Recording& recording = contents.recording;
  const Triggers& triggers = recording.triggers;
  if (triggers.rising_us.empty() && triggers.falling_us.empty()) return;
  if (std::none_of(files.begin(), files.end(), lacks_length)) return;
  prefer_channel(options, files.size(), recording);
  const auto pulses = exposures_of(triggers, options.trigger_level);
  const Edges edges = edges_per_frame(pulses, triggers, options.trigger_level, files.size());
  // Names may be times of a clock that the edges are to replace.
  const bool have_times = std::all_of(files.begin(), files.end(), [](const FrameFile& f) {
    return f.time.has_value() && !f.has_named_time;
  });
  if (have_times) {
    std::stable_sort(files.begin(), files.end(), [](const FrameFile& a, const FrameFile& b) {
      return a.time->begin_us < b.time->begin_us;
    });
  }
  const bool are_others = pulses.size() != files.size() && have_times && !follow(files, edges.us);
  if (edges.us.empty() || are_others) {
    recording.warnings.push_back(
        concat("expected one pulse or edge of the trigger input per frame, found ",
               said_of(triggers, pulses), " for ", files.size(), " frames",
               edges.us.empty() ? "" : " with times that do not follow them",
               "; they are not used: give the exposures with --frame-times, or remove the frames "
               "without a pulse"));
    return;
  }
  if (pulses.size() != files.size()) check_level(options, files.size(), recording);
  const bool have_lengths = pulses.size() == files.size() && options.exposure_ms <= 0;
  for (size_t i = 0; i < files.size(); ++i)
    files[i].time = have_lengths ? pulses[i] : events::TimeWindow{edges.us[i], edges.us[i]};
  if (have_lengths) {
    recording.notes.push_back(concat("exposures are those of ", pulses.size(),
                                     " pulses of the trigger input, of ", length_of(pulses),
                                     "; if these only mark a time, as a strobe's do, give the "
                                     "length with --exposure-ms"));
    return;
  }
  recording.stamp = options.stamp.value_or(edges.marks);
  recording.notes.push_back(concat("the trigger input has ", said_of(triggers, pulses), " for ",
                                   files.size(), " frames; they mark the ",
                                   word_of(recording.stamp), " of each exposure"));
}

/// Warns of times that lost digits.
void check_resolution(const std::vector<FrameFile>& files, std::vector<std::string>& warnings) {
  std::vector<events::TimeWindow> times;
  for (const FrameFile& file : files) {
    if (file.time) times.push_back(*file.time);
  }
  if (std::string fault = events::resolution_fault(times); !fault.empty())
    warnings.push_back(std::move(fault));
}

/// Stamps of 0 mean that a driver wrote no times, which has a message of its own.
/// @throws DataError naming two frames with the same time.
void check_own_times(const fs::path& source, const std::vector<FrameFile>& files) {
  std::vector<const FrameFile*> timed;
  for (const FrameFile& file : files) {
    if (file.time) timed.push_back(&file);
  }
  const auto key = [](const FrameFile* file) {
    return std::pair(file->time->begin_us, file->time->end_us);
  };
  std::stable_sort(timed.begin(), timed.end(),
                   [&](const FrameFile* a, const FrameFile* b) { return key(a) < key(b); });
  const auto same =
      std::adjacent_find(timed.begin(), timed.end(), [&](const FrameFile* a, const FrameFile* b) {
        return key(a) == key(b) && !may_lack_stamp(*a->time);
      });
  if (same == timed.end()) return;
  throw DataError(concat(source.string(), ": expected a time of its own for each frame, found ",
                         same[0]->path.filename().string(), " and ",
                         same[1]->path.filename().string(), " both at ", same[0]->time->begin_us,
                         " us; correct their times, with more digits if they were rounded"));
}

}  // namespace

void choose_channel(const fs::path& path, const std::map<int64_t, Triggers>& channels,
                    Recording& recording) {
  const auto count = [](const Triggers& edges) {
    return edges.rising_us.size() + edges.falling_us.size();
  };
  const auto most = std::max_element(channels.begin(), channels.end(), [&](auto& a, auto& b) {
    return count(a.second) < count(b.second);
  });
  if (most == channels.end()) return;
  recording.triggers = sorted(most->second);
  for (const auto& [channel, edges] : channels) {
    if (channel == most->first) continue;
    recording.other_triggers[channel] = sorted(edges);
    recording.notes.push_back(concat(path.string(), ": ", count(edges),
                                     " trigger edges of channel ", channel,
                                     " are left out; those of channel ", most->first, " are more"));
  }
}

namespace {

/// Assigns the times of options.frame_times: arrays of NumPy, numbers, or a list of names.
void apply_given_times(const ReadOptions& options, Contents& contents) {
  const std::filesystem::path& list = options.frame_times;
  auto& files = contents.files;
  Recording& recording = contents.recording;
  if (list.empty()) return;
  const bool arrays = in_small_letters(list.extension().string()) == ".npz" && io::is_zip(list);
  if (arrays && !files.empty()) return add_npz_times(list, options.time_unit, files, recording);
  if (!apply_numbers(list, options, files, recording) &&
      !apply_named_times(list, options, files, recording))
    apply_exposures(list, read_exposures(list), files, recording);
}

}  // namespace

void complete_exposures(const ReadOptions& options, Contents& contents) {
  Recording& recording = contents.recording;
  auto& files = contents.files;
  recording.stamp = options.stamp.value_or(recording.stamp);
  apply_given_times(options, contents);
  apply_triggers(options, contents);
  check_own_times(options.frames.empty() ? recording.source : options.frames, files);
  check_resolution(files, recording.warnings);
  const auto length = std::llround(1e3 * options.exposure_ms);
  for (FrameFile& file : files) {
    if (length > 0 && file.time && file.time->duration_us() == 0)
      file.time = exposure_at(file.time->begin_us, length, recording.stamp);
  }
  const auto untimed =
      std::find_if(files.begin(), files.end(), [](const auto& f) { return !f.time; });
  if (options.frames.empty() || untimed == files.end()) return;
  const Triggers& edges = recording.triggers;
  const bool has_edges = !edges.rising_us.empty() || !edges.falling_us.empty();
  throw DataError(concat(options.frames.string(), ": expected one time per frame, found ",
                         files.size(), " frames without times",
                         has_edges ? " and, on the trigger input, " +
                                         said_of(edges, exposures_of(edges, options.trigger_level))
                                   : "",
                         "; ", kGiveTimes));
}

}  // namespace jade::recording
