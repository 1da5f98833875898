// SPDX-License-Identifier: Apache-2.0
#include "jade/data/frame_times.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/io/npy.h"

namespace jade::data {
namespace {

using events::TimeUnit;

constexpr double kShortestUs = 10;
constexpr double kLongestUs = 5e6;
constexpr double kLatestUs = 4e18;  // differences of two such times still fit an int64

/// The unit in which the median exposure of `durations` (raw values, sharp frames left out) is
/// plausible; µs where all are sharp.
TimeUnit guess_unit(std::vector<double> durations, bool floating, const std::string& path) {
  if (durations.empty()) return floating ? TimeUnit::kS : TimeUnit::kUs;
  std::nth_element(durations.begin(), durations.begin() + durations.size() / 2, durations.end());
  const double median = durations[durations.size() / 2];
  for (const TimeUnit unit : {TimeUnit::kUs, TimeUnit::kNs, TimeUnit::kS}) {
    if (unit == TimeUnit::kS && !floating) continue;
    const double us = median * us_per_unit(unit);
    if (us >= kShortestUs && us <= kLongestUs) return unit;
  }
  throw DataError(concat(path, ": the median exposure is ", median,
                         ", which is no plausible time in us, ns or s; set dataset.time_unit"));
}

/// A multiple of `step` positions, or the tail, or neither.
std::string describe_pattern(const std::vector<bool>& is_test) {
  std::vector<size_t> at;
  for (size_t i = 0; i < is_test.size(); ++i) {
    if (is_test[i]) at.push_back(i);
  }
  if (at.empty()) return "no test views";
  if (at.front() + at.size() == is_test.size()) return concat("the last ", at.size(), " frames");
  if (at.size() > 1 && at[0] == 0) {
    const size_t step = at[1];
    bool regular = (is_test.size() - 1) / step + 1 == at.size();
    for (size_t i = 0; i < at.size(); ++i) regular = regular && at[i] == i * step;
    if (regular) return concat("every ", step, "th frame from the first");
  }
  return concat(at.size(), " frames between the others");
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

}  // namespace

double us_per_unit(TimeUnit unit) {
  JADE_CHECK(unit != TimeUnit::kAuto, "unit of time: expected us, ns or s, found auto");
  return unit == TimeUnit::kS ? 1e6 : unit == TimeUnit::kNs ? 1e-3 : 1;
}

std::vector<int64_t> times_us(const torch::Tensor& times, TimeUnit unit, const std::string& name) {
  if (times.dim() != 1) {
    throw DataError(concat(name, ": expected one list of times, found shape ", times.sizes()));
  }
  const double factor = us_per_unit(unit);
  const auto implausible = [&](size_t index, double value) {
    return DataError(concat(name, ": time ", index, " is ", value, " ", word_of(unit),
                            "; export the times again"));
  };
  std::vector<int64_t> out(static_cast<size_t>(times.numel()));
  if (!times.is_floating_point()) {
    const torch::Tensor values = times.to(torch::kInt64).contiguous();
    const int64_t* value = values.data_ptr<int64_t>();
    // Dividing integers keeps nanoseconds since 1970, which a double would round.
    for (size_t i = 0; i < out.size(); ++i) {
      if (std::abs(double(value[i]) * factor) > kLatestUs) throw implausible(i, double(value[i]));
      out[i] = unit == TimeUnit::kNs  ? value[i] / 1000 + (value[i] % 1000 >= 500 ? 1 : 0)
               : unit == TimeUnit::kS ? static_cast<int64_t>(double(value[i]) * factor)
                                      : value[i];
    }
    return out;
  }
  const torch::Tensor values = times.to(torch::kFloat64).contiguous();
  const double* value = values.data_ptr<double>();
  for (size_t i = 0; i < out.size(); ++i) {
    if (!std::isfinite(value[i]) || std::abs(value[i] * factor) > kLatestUs) {
      throw implausible(i, value[i]);
    }
    out[i] = std::llround(value[i] * factor);
  }
  return out;
}

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
  const bool floating = start.is_floating_point();
  TimeUnit known = unit;
  if (unit == TimeUnit::kAuto) {
    const torch::Tensor lengths = (end - start).to(torch::kFloat64).contiguous();
    std::vector<double> durations(lengths.data_ptr<double>(),
                                  lengths.data_ptr<double>() + lengths.numel());
    durations.erase(std::remove_if(durations.begin(), durations.end(),
                                   [](double value) { return !(value > 0); }),
                    durations.end());
    known = guess_unit(std::move(durations), floating, path.string());
  }
  const std::vector<int64_t> starts = times_us(start, known, path.string() + "[timestamps_start]");
  const std::vector<int64_t> ends = times_us(end, known, path.string() + "[timestamps_end]");
  FrameTimes times{std::vector<FrameTime>(starts.size()), known};
  for (size_t i = 0; i < starts.size(); ++i) {
    times.frames[i] = {starts[i], ends[i]};
    if (ends[i] < starts[i]) {
      throw DataError(concat(path.string(), ": frame ", i, " ends at ", ends[i],
                             " us, before its start at ", starts[i], " us; swap the two arrays"));
    }
  }
  return times;
}

Split split_frames(const std::vector<FrameTime>& times, const SplitRule& rule,
                   const std::string& path, const Warnings& warnings) {
  Split split;
  if (rule.kind == SplitKind::kAuto) {
    for (const FrameTime& time : times) split.is_test.push_back(time.sharp());
    check_train_left(split.is_test, path);
    split.rule = concat(describe_pattern(split.is_test), ", by their zero exposure time");
    if (std::count(split.is_test.begin(), split.is_test.end(), true) == 0) {
      warnings.add(path,
                   ": no frame has timestamps_start equal to timestamps_end, so there are no "
                   "test views; set dataset.split to last or every if there should be");
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

Split split_by_position(size_t count, const SplitRule& rule, const std::string& path) {
  SplitRule known = rule;
  if (rule.kind == SplitKind::kAuto) known.kind = SplitKind::kEvery;
  Split split{positions(count, known), ""};
  if (rule.kind == SplitKind::kAuto && count < 2) split.is_test.assign(count, false);
  split.rule = describe_pattern(split.is_test);
  check_train_left(split.is_test, path);
  return split;
}

}  // namespace jade::data
