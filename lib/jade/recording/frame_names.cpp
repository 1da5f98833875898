// SPDX-License-Identifier: Apache-2.0
// Times in the names of frames: TUM RGB-D 1305031102.175304.png in s, EuRoC 1403636579763555584.png
// in ns.
#include <algorithm>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/median.h"
#include "jade/core/text.h"
#include "jade/imaging/image_io.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

using events::TimeUnit;

/// Frame periods of real cameras.
constexpr double kShortestUs = 200, kLongestUs = 2e6, kLongestOfClockUs = 6e7;

/// The unit in which a time is one from 2001 to 2096, counted from 1970; no value: in none.
std::optional<TimeUnit> unit_since_1970(double time) {
  for (const TimeUnit unit : {TimeUnit::kS, TimeUnit::kMs, TimeUnit::kUs, TimeUnit::kNs}) {
    const double seconds = 1e-6 * events::us_per_unit(unit) * time;
    if (seconds >= 1e9 && seconds < 4e9) return unit;
  }
  return std::nullopt;
}

/// A frame's number, with or without a decimal point, if its name is nothing else.
std::optional<double> number_named(const std::filesystem::path& file) {
  const std::string name = file.stem().string();
  if (name.find_first_not_of("0123456789.") != std::string::npos ||
      std::count(name.begin(), name.end(), '.') > 1)
    return std::nullopt;
  return number_in(name);
}

}  // namespace

std::optional<TimeUnit> likely_unit(const std::vector<double>& times) {
  const double step = median_step(times);
  const auto is_period = [&](TimeUnit unit, double longest_us) {
    const double step_us = step * events::us_per_unit(unit);
    return step_us >= kShortestUs && step_us <= longest_us;
  };
  if (times.empty()) return std::nullopt;
  const std::optional<TimeUnit> clock = unit_since_1970(times.back());
  if (clock && is_period(*clock, kLongestOfClockUs)) return clock;
  for (const TimeUnit unit : {TimeUnit::kUs, TimeUnit::kNs, TimeUnit::kS, TimeUnit::kMs}) {
    if (times.back() > events::kOnlyNs && unit != TimeUnit::kNs) continue;
    if (is_period(unit, kLongestUs)) return unit;
  }
  return std::nullopt;
}

bool add_times_of_names(const std::filesystem::path& images, const ReadOptions& options,
                        std::vector<FrameFile>& files, Recording& recording) {
  constexpr double kCounts = 2000;  // smaller steps of whole numbers may be frame numbers
  constexpr double kLargest = 4e18;
  std::vector<std::pair<double, size_t>> named;  // and the file
  std::vector<std::string> others;
  std::vector<std::filesystem::path> paths;
  bool has_point = false;
  for (size_t i = 0; i < files.size(); ++i) {
    const std::optional<double> time = number_named(files[i].path);
    if (!time) {
      others.push_back(files[i].path.filename().string());
      continue;
    }
    named.emplace_back(*time, i);
    paths.push_back(files[i].path);
    has_point |= files[i].path.stem().string().find('.') != std::string::npos;
  }
  if (named.size() < 2 || 10 * others.size() > files.size() + 9) return false;
  std::sort(named.begin(), named.end());
  std::vector<double> times;
  for (const auto& [time, file] : named) times.push_back(time);
  const bool are_distinct = std::adjacent_find(times.begin(), times.end()) == times.end();
  if (!are_distinct || times.back() > kLargest) return false;
  std::optional<TimeUnit> unit = likely_unit(times);
  const bool on_clock = unit && unit_since_1970(times.back()) == unit;
  if (has_point && !on_clock) {
    const double step_us = 1e6 * median_step(times);
    unit.reset();
    if (step_us >= kShortestUs && step_us <= kLongestOfClockUs && !imaging::counts_fractions(paths))
      unit = TimeUnit::kS;
  }
  if (!unit || (!has_point && !on_clock && median_step(times) < kCounts)) return false;
  if (options.time_unit != TimeUnit::kAuto) unit = options.time_unit;
  const std::vector<int64_t> at =
      events::times_us(torch::tensor(times, torch::kFloat64), *unit, images.string());
  const Stamp stamp = options.stamp.value_or(recording.stamp);
  std::vector<FrameFile> timed;
  for (size_t i = 0; i < named.size(); ++i)
    timed.push_back({files[named[i].second].path, exposure_at(at[i], 0, stamp), true});
  recording.notes.push_back(
      concat(images.string(), ": the names of the frames are read as their times, in ",
             word_of(*unit), "; each is taken as the ", word_of(stamp), " of the exposure"));
  if (!others.empty()) {
    recording.warnings.push_back(concat(images.string(),
                                        ": expected times as names of all frames, found other ",
                                        "names: ", listing(others), "; these are left out"));
  }
  files = std::move(timed);
  check_apart(images, files, recording);
  return true;
}

}  // namespace jade::recording
