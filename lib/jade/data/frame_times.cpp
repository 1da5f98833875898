// SPDX-License-Identifier: Apache-2.0
#include "jade/data/frame_times.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/io/npy.h"

namespace jade::data {
namespace {

using events::TimeUnit;

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
  const TimeUnit known =
      unit == TimeUnit::kAuto
          ? events::guess_exposure_unit(start, end, path.string(), "set dataset.time_unit")
          : unit;
  const std::vector<int64_t> starts =
      events::times_us(start, known, path.string() + "[timestamps_start]");
  const std::vector<int64_t> ends =
      events::times_us(end, known, path.string() + "[timestamps_end]");
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
