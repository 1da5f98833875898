// SPDX-License-Identifier: Apache-2.0
#include "jade/data/frame_times.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/core/median.h"
#include "jade/core/text.h"
#include "jade/events/stream_faults.h"
#include "jade/io/npy.h"

namespace jade::data {
namespace {

using events::TimeUnit;

/// Describes test positions: a multiple of `step`, the tail, or neither.
std::string describe_pattern(const std::vector<bool>& is_test) {
  std::vector<size_t> at;
  for (size_t i = 0; i < is_test.size(); ++i) {
    if (is_test[i]) at.push_back(i);
  }
  if (at.empty()) return "no test views";
  if (at.front() + at.size() == is_test.size()) {
    return at.size() == 1 ? "the last frame" : concat("the last ", at.size(), " frames");
  }
  if (at.size() > 1 && at[0] == 0) {
    const size_t step = at[1];
    bool regular = (is_test.size() - 1) / step + 1 == at.size();
    for (size_t i = 0; i < at.size(); ++i) regular = regular && at[i] == i * step;
    if (regular) return concat("every ", step, "th frame from the first");
  }
  return concat(at.size(), at.size() == 1 ? " frame" : " frames", " between the others");
}

std::vector<bool> positions(size_t count, const SplitRule& rule) {
  std::vector<bool> is_test(count, false);
  for (size_t i = 0; i < count; ++i) {
    if (rule.kind == SplitKind::kLast) is_test[i] = int64_t(i) >= int64_t(count) - rule.last;
    if (rule.kind == SplitKind::kEvery) is_test[i] = int64_t(i) % rule.every == 0;
  }
  return is_test;
}

void check_train_left(const std::vector<bool>& is_test, const std::string& path) {
  if (std::find(is_test.begin(), is_test.end(), false) != is_test.end()) return;
  throw DataError(concat(path, ": all ", is_test.size(),
                         " frames would be test views and none is left for training; set "
                         "dataset.split"));
}

/// @throws DataError if no frame has an exposure, so that none can be used for training.
void check_exposed(const std::vector<FrameTime>& times, const std::string& path) {
  const auto is_sharp = [](const FrameTime& time) { return time.sharp(); };
  if (!std::all_of(times.begin(), times.end(), is_sharp)) return;
  throw DataError(concat(path, ": expected exposures of the training frames, found ",
                         "timestamps_start equal to timestamps_end for all ", times.size(),
                         "; write the start and the end of each exposure into these two arrays"));
}

/// @throws DataError if a type with less precision than float64 rounds times by more than a
///   fiftieth of the frame period.
void check_precision(const torch::Tensor& times, const std::string& name) {
  constexpr double kLargestShare = 0.02;
  constexpr double kFinest = 1e-3;  // smaller steps are negligible in every unit
  const bool is_half = times.scalar_type() == torch::kFloat16;
  if ((times.scalar_type() != torch::kFloat32 && !is_half) || times.numel() < 2) return;
  const torch::Tensor wide = times.to(torch::kFloat64);
  const auto [low, high] = wide.aminmax();
  const double first = low.item<double>(), last = high.item<double>();
  const double size = std::max(std::abs(first), std::abs(last));
  if (!std::isfinite(size) || size == 0) return;
  const double step = std::ldexp(1.0, std::ilogb(size) - (is_half ? 10 : 23));
  const double period = (last - first) / double(times.numel() - 1);
  if (step < kFinest || step <= kLargestShare * period) return;
  throw DataError(concat(name, ": expected times that differ from frame to frame, found ",
                         is_half ? "float16" : "float32", " numbers near ", size,
                         ", where the type has a value every ", step,
                         "; store the times as float64 or as integers, from their source"));
}

/// @throws DataError for a median exposure that no camera takes, as in another unit.
void check_lengths(const FrameTimes& times, const std::string& path) {
  std::vector<int64_t> lengths;
  for (const FrameTime& time : times.frames) {
    if (!time.sharp()) lengths.push_back(time.end_us - time.start_us);
  }
  if (lengths.empty()) return;
  const auto length_us = double(median_of(std::move(lengths)));
  if (length_us <= events::kLongestExposureUs) return;
  throw DataError(concat(path, ": expected exposures of at most ",
                         1e-6 * events::kLongestExposureUs, " s, found a median of ",
                         1e-6 * length_us, " s in ", word_of(times.unit),
                         "; set dataset.time_unit to the unit of the file"));
}

}  // namespace

FrameTimes read_frame_times(const std::filesystem::path& path, TimeUnit unit) {
  const io::Npz archive(path);
  const torch::Tensor start = archive.read("timestamps_start");
  const torch::Tensor end = archive.read("timestamps_end");
  if (start.dim() != 1 || start.sizes() != end.sizes()) {
    throw DataError(concat(path.string(),
                           ": expected timestamps_start and timestamps_end of one "
                           "length, found ",
                           start.sizes(), " and ", end.sizes()));
  }
  check_precision(start, path.string() + "[timestamps_start]");
  check_precision(end, path.string() + "[timestamps_end]");
  const TimeUnit known =
      unit == TimeUnit::kAuto
          ? events::guess_exposure_unit(start, end, path.string(), "set dataset.time_unit")
          : unit;
  const std::vector<int64_t> starts =
      events::times_us(start, known, path.string() + "[timestamps_start]");
  const std::vector<int64_t> ends =
      events::times_us(end, known, path.string() + "[timestamps_end]");
  FrameTimes times{std::vector<FrameTime>(starts.size()), known};
  size_t reversed = 0;
  for (size_t i = 0; i < starts.size(); ++i) {
    times.frames[i] = {starts[i], ends[i]};
    reversed += ends[i] < starts[i] ? 1 : 0;
  }
  for (size_t i = 0; i < starts.size() && reversed > 0; ++i) {
    if (ends[i] >= starts[i]) continue;
    throw DataError(concat(
        path.string(), ": frame ", i, " ends at ", ends[i], " us, before its start at ", starts[i],
        2 * reversed > starts.size() ? " us; swap the two arrays"
                                     : " us; correct its times, or leave the frame out"));
  }
  check_lengths(times, path.string());
  return times;
}

void check_apart(const std::vector<FrameTime>& times, const std::vector<std::string>& names,
                 const std::string& path, const Warnings& warnings) {
  std::vector<events::NamedWindow> exposed;
  std::vector<events::TimeWindow> windows;
  for (size_t i = 0; i < times.size(); ++i) {
    if (times[i].sharp()) continue;
    windows.push_back({times[i].start_us, times[i].end_us});
    exposed.push_back({names.at(i), windows.back()});
  }
  if (const std::string fault = events::resolution_fault(windows); !fault.empty())
    warnings.add(path, ": ", fault);
  if (const std::string fault = events::overlap_fault(path, std::move(exposed)); !fault.empty())
    warnings.add(fault);
}

std::string milliseconds_note(const FrameTimes& times, events::TimeUnit wanted,
                              const std::filesystem::path& path) {
  if (wanted != TimeUnit::kAuto || times.unit != TimeUnit::kMs) return "";
  return concat(path.string(),
                ": times are read as milliseconds, as no camera takes frames at the rate and of "
                "the length that they say in us or s; dataset.time_unit names another unit");
}

namespace {

/// Warns of frames whose exposure is a tiny part of the others', as sharp frames have.
void tell_short(const std::vector<FrameTime>& times, const std::string& path,
                const Warnings& warnings) {
  constexpr double kTiny = 0.02;
  std::vector<int64_t> lengths;
  for (const FrameTime& time : times) {
    if (!time.sharp()) lengths.push_back(time.end_us - time.start_us);
  }
  const int64_t usual = median_of(std::move(lengths));
  std::vector<std::string> found;
  for (size_t i = 0; i < times.size(); ++i) {
    const int64_t length = times[i].end_us - times[i].start_us;
    if (!times[i].sharp() && double(length) < kTiny * double(usual))
      found.push_back(concat(i, " (", length, " us)"));
  }
  if (found.empty()) return;
  warnings.add(path, ": expected exposures of about ", usual, " us, found much shorter ones of ",
               found.size() == 1 ? "frame " : "frames ", listing(found),
               ", which train as blurry frames; write equal timestamps_start and timestamps_end "
               "for sharp test views");
}

}  // namespace

Split split_frames(const std::vector<FrameTime>& times, const SplitRule& rule,
                   const std::string& path, const Warnings& warnings) {
  check_exposed(times, path);
  Split split;
  if (rule.kind == SplitKind::kAuto) {
    tell_short(times, path, warnings);
    for (const FrameTime& time : times) split.is_test.push_back(time.sharp());
    split.rule = concat(describe_pattern(split.is_test), ", by their zero exposure time");
    if (std::count(split.is_test.begin(), split.is_test.end(), true) == 0) {
      warnings.add(path,
                   ": no frame has timestamps_start equal to timestamps_end, so there are no "
                   "test views; set dataset.split to last or every if some frames are sharp, or "
                   "name exposures to score in held_out.txt");
    }
    return split;
  }
  split.is_test = positions(times.size(), rule);
  split.rule = concat(describe_pattern(split.is_test), ", by dataset.split ", word_of(rule.kind));
  check_train_left(split.is_test, path);
  for (size_t i = 0; i < times.size(); ++i) {
    if (split.is_test[i] == times[i].sharp()) continue;
    if (split.is_test[i]) {
      warnings.add(path, ": test view ", i, " has an exposure of ",
                   times[i].end_us - times[i].start_us, " us, so it may be blurred");
    } else {
      throw DataError(concat(path, ": frame ", i, " is for training by dataset.split ",
                             word_of(rule.kind),
                             " but has no exposure time; set dataset.split to auto"));
    }
  }
  return split;
}

SplitRule position_rule(const DatasetOptions& options, const Warnings& warnings) {
  SplitRule rule{options.split, options.test_last, options.test_every, ""};
  if (options.split != SplitKind::kAuto) return rule;
  const std::string start = "hold=";
  std::vector<std::string> found;
  for (const auto& entry : std::filesystem::directory_iterator(options.path)) {
    const std::string name = entry.path().filename().string();
    if (name.rfind(start, 0) == 0) found.push_back(name);
  }
  if (found.empty()) return rule;
  std::sort(found.begin(), found.end());
  const std::string number = found.front().substr(start.size());
  const bool is_number =
      !number.empty() && number.size() < 7 && number.find_first_not_of("0123456789") == number.npos;
  if (found.size() > 1 || !is_number || std::stoll(number) < 2) {
    warnings.add(options.path.string(), ": expected one file hold=N with N of 2 or more, found ",
                 listing(found), "; every ", rule.every,
                 "th frame is a test view; set dataset.split to every and dataset.test_every");
    return rule;
  }
  rule.every = std::stoll(number);
  rule.source = found.front();
  return rule;
}

Split split_by_position(size_t count, const SplitRule& rule, const std::string& path) {
  SplitRule known = rule;
  if (rule.kind == SplitKind::kAuto) known.kind = SplitKind::kEvery;
  Split split{positions(count, known), ""};
  if (rule.kind == SplitKind::kAuto && count < 2) split.is_test.assign(count, false);
  split.rule = describe_pattern(split.is_test);
  if (!rule.source.empty()) split.rule += ", by " + rule.source;
  check_train_left(split.is_test, path);
  return split;
}

}  // namespace jade::data
