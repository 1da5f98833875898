// SPDX-License-Identifier: Apache-2.0
#include "jade/events/event_files.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <fstream>
#include <limits>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/machine_memory.h"
#include "jade/core/readable.h"
#include "jade/core/text.h"
#include "jade/events/raw_events.h"
#include "jade/events/stream_faults.h"
#include "jade/events/time_faults.h"
#include "jade/io/stand_in.h"

namespace jade::events {
namespace {

/// For a message: the range of polarities as read, clamped to int8.
std::string values_from(const torch::Tensor& polarity) {
  const int low = polarity.min().item<int>(), high = polarity.max().item<int>();
  return concat("numbers from ", low, low == -128 ? " or less" : "", " to ", high,
                high == 127 ? " or more" : "");
}

/// 0/1 → −1/+1 in place.
void make_signs(const std::filesystem::path& path, torch::Tensor& polarity) {
  int8_t* p = polarity.mutable_data_ptr<int8_t>();
  std::atomic<bool> zeros{false}, negatives{false}, others{false};
  at::parallel_for(0, polarity.numel(), kEventGrain, [&](int64_t begin, int64_t end) {
    bool zero = false, negative = false, other = false;
    for (int64_t i = begin; i < end; ++i) {
      zero |= p[i] == 0;
      negative |= p[i] == -1;
      other |= p[i] < -1 || p[i] > 1;
    }
    if (zero) zeros = true;
    if (negative) negatives = true;
    if (other) others = true;
  });
  if (others || (zeros && negatives)) {
    throw DataError(concat(path.string(), ": expected polarities 0/1 or -1/+1, found ",
                           others ? values_from(polarity) : "-1 and 0 together",
                           "; store 1 for brighter and 0 for darker"));
  }
  if (!zeros) return;
  at::parallel_for(0, polarity.numel(), kEventGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) p[i] = p[i] == 0 ? int8_t(-1) : int8_t(1);
  });
}

struct TimeRange {
  double first = std::numeric_limits<double>::infinity();
  double last = -std::numeric_limits<double>::infinity();
  bool has_fraction = false;
  int64_t count = 0;
  double usual_first = 0, usual_last = 0;  ///< from which the unit is guessed

  /// Takes the range of all times but a hundredth at either end, which may be damaged, if it is
  /// less than half of the whole.
  void set_usual(double begin, double end) {
    const bool is_less = last - first > 2 * (end - begin);
    usual_first = is_less ? begin : first;
    usual_last = is_less ? end : last;
  }
};

constexpr int64_t kTrimmed = 100;        // one in this many times
constexpr int64_t kFewestTrimmed = 200;  // times

/// Sets the usual range from a sample of the times.
void set_usual(const torch::Tensor& time, TimeRange& range) {
  constexpr int64_t kSample = 4096;
  const int64_t count = std::min(time.numel(), kSample);
  if (count < kFewestTrimmed) return range.set_usual(range.first, range.last);
  const torch::Tensor places = torch::linspace(0, double(time.numel() - 1), count, torch::kFloat64)
                                   .round()
                                   .to(torch::kInt64);
  const torch::Tensor sample = std::get<0>(time.index_select(0, places).to(torch::kFloat64).sort());
  range.set_usual(sample[count / kTrimmed].item<double>(),
                  sample[count - 1 - count / kTrimmed].item<double>());
}

/// @throws DataError for times that an int64 cannot hold, such as negative times stored as uint64.
void check_range(const std::filesystem::path& path, double first, double last) {
  if (!std::isfinite(first) || !std::isfinite(last)) {
    throw DataError(concat(path.string(), ": expected finite event times, found NaN or Inf"));
  }
  constexpr double kLargest = 9e18;
  if (std::max(-first, last) <= kLargest) return;
  throw DataError(concat(path.string(), ": expected event times below 2^63, found ", last,
                         "; negative times in unsigned integers, or a counter that wrapped, look "
                         "like this: store the times as int64"));
}

TimeRange range_of(const std::filesystem::path& path, const torch::Tensor& time) {
  TimeRange out;
  if (time.numel() == 0) return out;
  const auto [low, high] = time.aminmax();
  out.first = low.to(torch::kFloat64).item<double>();
  out.last = high.to(torch::kFloat64).item<double>();
  check_range(path, out.first, out.last);
  if (time.is_floating_point()) {
    const double* t = time.const_data_ptr<double>();
    out.has_fraction =
        std::any_of(t, t + time.numel(), [](double v) { return v != std::floor(v); });
  }
  out.count = time.numel();
  set_usual(time, out);
  return out;
}

/// Times in µs; the int64 array of a file in µs is used as it is.
torch::Tensor to_us(const torch::Tensor& time, TimeUnit unit) {
  if (time.is_floating_point()) {
    // Seconds and ms are decimal fractions: round to the nearest microsecond.
    const bool decimal = unit == TimeUnit::kS || unit == TimeUnit::kMs;
    const auto scaled = time * us_per_unit(unit);
    return (decimal ? scaled.round() : scaled.floor()).to(torch::kInt64);
  }
  if (unit == TimeUnit::kUs) return time;
  int64_t* t = time.mutable_data_ptr<int64_t>();
  const auto factor = static_cast<int64_t>(us_per_unit(unit));
  at::parallel_for(0, time.numel(), kEventGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      t[i] = unit == TimeUnit::kNs ? (t[i] >= 0 ? t[i] / 1000 : -((-t[i] + 999) / 1000))
                                   : t[i] * factor;
    }
  });
  return time;
}

ClockOrder order_of(const torch::Tensor& t_us) {
  const int64_t* const t = t_us.const_data_ptr<int64_t>();
  ClockOrder order;
  if (std::is_sorted(t, t + t_us.numel())) return order;
  std::for_each(t, t + t_us.numel(), [&](int64_t time) { order.add(time); });
  return order;
}

double in_unit(int64_t us, TimeUnit unit) {
  return unit == TimeUnit::kNs ? double(us) * 1e3 : double(us) / us_per_unit(unit);
}

/// "in ns the events last 5.1 s, the exposures 5 s; …", if `unit` (kAuto: none) fits less; else
/// empty.
std::string other_unit(double first, double last, TimeUnit unit, const TimeWindow& exposures) {
  const std::optional<TimeUnit> other = unit_by_length(first, last, unit, exposures);
  if (!other) return "";
  return concat("in ", word_of(*other), " the events last ",
                readable(1e-6 * us_per_unit(*other) * (last - first), 3), " s, the exposures ",
                readable(1e-6 * double(exposures.duration_us()), 3),
                " s, but from another time on; if they are ", word_of(*other),
                ", write them again on the clock of the frames");
}

DataError two_clocks(const std::filesystem::path& path, double first, double last,
                     const TimeWindow& exposures, TimeUnit unit, const std::string& found) {
  const std::string hint = other_unit(first, last, unit, exposures);
  return DataError(concat(path.string(), ": events run from ", first, " to ", last,
                          ", exposures from ", exposures.begin_us, " to ", exposures.end_us,
                          " us: ", found, hint.empty() ? "" : "; ", hint,
                          "; are both of one recording, and is the offset between ",
                          "them right (jade_import: --offset-ms)?"));
}

/// Checks a guessed unit that is not the usual one of such numbers by the events. Exposures in
/// another unit than their file's, or on another clock, may suggest a wrong one.
/// @throws DataError if the events are too many per second, or much shorter than the exposures and
///   about as long as these in another unit.
void check_unusual(const std::filesystem::path& path, const EventFileResult& read,
                   const TimeWindow& exposures) {
  constexpr double kFastest = 100, kShorter = 0.01;  // events per us, of the exposures
  constexpr int64_t kFewest = 100;
  const TimeUnit unit = read.time_unit;
  const auto length_us = double(read.stored_us.duration_us());
  if (read.stored < kFewest) return;
  const double first = in_unit(read.stored_us.begin_us, unit);
  const double last = in_unit(read.stored_us.end_us, unit);
  if (length_us < kShorter * double(exposures.duration_us()) &&
      unit_by_length(first, last, unit, exposures)) {
    throw two_clocks(path, first, last, exposures, unit,
                     "the two clocks overlap in no likely unit");
  }
  const double rate = double(read.stored) / length_us;
  if (rate < kFastest) return;
  throw DataError(concat(path.string(), ": expected at most ", kFastest,
                         " million events per second, found ", readable(rate, 3),
                         " million, read as ", word_of(unit),
                         ", the unit in which they cover the exposures from ", exposures.begin_us,
                         " to ", exposures.end_us,
                         " us; are the times of the frames in milliseconds? Convert them to "
                         "microseconds, or set dataset.time_unit"));
}

/// Checks a guessed unit by the events. A wrong one may spread the events over years, of which the
/// exposures cover a moment.
/// @throws DataError if almost no event falls between the first and the last exposure.
void check_guess(const std::filesystem::path& path, const EventFileResult& read,
                 const TimeWindow& exposures) {
  constexpr int64_t kFewest = 100, kFew = 100, kRare = 100, kRarest = 100000, kLong = 1000;
  const TimeUnit unit = read.time_unit;
  const int64_t stored = read.stored, inside = read.events.slice(exposures).size();
  if (stored < kFewest || inside * kRare >= stored) return;
  if (inside >= kFew && inside * kRarest >= stored) return;
  // The events near the exposures may be all that was read; then only none is too few.
  if (read.events.size() < stored &&
      (inside > 0 || read.stored_us.duration_us() < kLong * exposures.duration_us()))
    return;
  throw two_clocks(path, in_unit(read.stored_us.begin_us, unit),
                   in_unit(read.stored_us.end_us - 1, unit), exposures, unit,
                   concat("the two clocks overlap in no likely unit; ", inside, " of ", stored,
                          " events lie between the first and the last exposure"));
}

/// Leaves out copies of events, and warns of them and of other repetitions.
void drop_copies(const std::filesystem::path& path, EventFileResult& result) {
  const DistinctEvents distinct = without_copies(result.events);
  if (!distinct.fault.empty())
    result.warnings.push_back(concat(path.string(), ": ", distinct.fault));
  result.events = distinct.events;
  result.stored -= distinct.copies;
}

const char* name_of(TimeUnit unit) {
  return unit == TimeUnit::kS    ? "seconds"
         : unit == TimeUnit::kMs ? "milliseconds"
         : unit == TimeUnit::kNs ? "nanoseconds"
                                 : "microseconds";
}

/// @param said  unit in the name of the file's times
TimeUnit chosen_unit(const std::filesystem::path& path, const TimeRange& range, TimeUnit said,
                     const EventFileOptions& options) {
  if (options.time_unit != TimeUnit::kAuto) return options.time_unit;
  if (said != TimeUnit::kAuto) return said;
  if (range.first > range.last) return TimeUnit::kUs;
  const double first = range.usual_first, last = range.usual_last;
  if (!options.exposures && options.frames)
    return unit_beside_frames(first, last, range.has_fraction, range.count, *options.frames);
  const std::optional<TimeUnit> unit =
      guess_time_unit(first, last, range.has_fraction, options.exposures);
  if (unit) return *unit;
  throw two_clocks(path, first, last, *options.exposures, TimeUnit::kAuto,
                   "the two clocks do not overlap in us, ns, ms or s");
}

/// Stretches of the file that contain the requested events; the whole file if it is unsorted.
std::vector<Stretch> wanted_stretches(const std::filesystem::path& path, const Hdf5Events& file,
                                      const EventFileOptions& options, EventFileResult& result) {
  const TimeSurvey survey = file.survey();
  result.stored = survey.count();
  const bool ordered = survey.sorted() && survey.finite() && survey.count() > 0;
  std::vector<Stretch> stretches{{0, survey.count()}};
  if (ordered) {
    const int64_t count = survey.count();
    const int64_t trimmed = count < kFewestTrimmed ? 0 : count / kTrimmed;
    const auto at = [&](int64_t i) { return survey.times({i, i + 1}).front(); };
    TimeRange range{survey.smallest(), survey.largest(), survey.has_fraction(), count};
    range.set_usual(at(trimmed), at(count - 1 - trimmed));
    const TimeUnit unit = chosen_unit(path, range, file.unit(), options);
    check_range(path, survey.smallest(), survey.largest());
    check_resolution(path, survey.smallest(), survey.largest(), survey.count(), file.time_bits(),
                     unit);
    const int64_t some = std::min(count, kMostStrays + 1);
    const Stretch usual =
        without_strays(count, survey.times({0, some}), survey.times({count - some, count}),
                       in_unit(1000000, unit));
    if (std::string strays = strays_warning(usual, count); !strays.empty())
      result.warnings.push_back(concat(path.string(), ": ", strays));
    result.stored = usual.size();
    result.stored_us = {std::llround(at(usual.begin) / in_unit(1, unit)),
                        std::llround(at(usual.end - 1) / in_unit(1, unit)) + 1};
    stretches = {usual};
    // Other units are rounded when converted to µs.
    const int64_t more_us = unit == TimeUnit::kUs && !survey.has_fraction() ? 0 : 1;
    if (options.keep) stretches.clear();
    for (const TimeWindow& window : options.keep.value_or(std::vector<TimeWindow>())) {
      Stretch found = survey.between(in_unit(window.begin_us - more_us, unit),
                                     in_unit(window.end_us + more_us, unit));
      if (!stretches.empty()) found.begin = std::max(found.begin, stretches.back().end);
      if (found.size() > 0) stretches.push_back(found);
    }
  }
  if (options.most > 0) shorten(stretches, options.most);
  return stretches;
}

/// All events of a file, or only those in options.keep if the file allows finding them without
/// reading it whole.
RawEvents wanted_events(const std::filesystem::path& path, const EventFileOptions& options,
                        EventFileResult& result) {
  if (std::filesystem::is_directory(path)) {
    RawEvents raw = read_chunks(path, options.group, options.event_bytes, result.warnings);
    result.stored = raw.time.numel();
    return raw;
  }
  const EventFileKind kind = file_kind(path);
  if (kind != EventFileKind::kHdf5) {
    RawEvents raw = read_raw(path, kind, options.group);
    result.stored = raw.time.numel();
    check_event_memory(path, result.stored, options.event_bytes);
    return raw;
  }
  const Hdf5Events file(path, options.group);
  result.warnings = file.notes();
  if (!options.keep && options.most == 0) {
    result.stored = file.length();
    check_event_memory(path, result.stored, options.event_bytes);
    return file.read();
  }
  const std::vector<Stretch> stretches = wanted_stretches(path, file, options, result);
  int64_t count = 0;
  for (const Stretch& stretch : stretches) count += stretch.size();
  check_event_memory(path, count, options.event_bytes);
  return file.read(stretches);
}

/// Unwraps the times of a counter, with a note. Returns false if they do not wrap.
bool continue_counter(const std::filesystem::path& path, torch::Tensor& time,
                      EventFileResult& result) {
  if (time.is_floating_point()) {
    const double* const t = time.const_data_ptr<double>();
    if (std::is_sorted(t, t + time.numel())) return false;  // Does not copy the times.
  }
  torch::Tensor counts = time.to(torch::kInt64);
  const WrappedCounter found = unwrap_counter(counts);
  if (found.wraps == 0) return false;
  time = counts;
  result.warnings.push_back(
      concat(path.string(), ": event times are a counter of ", found.bits, " bits that wraps ",
             found.wraps, found.wraps == 1 ? " time" : " times", "; they have been continued"));
  return true;
}

}  // namespace

EventStream sort_events(const torch::Tensor& x, const torch::Tensor& y, const torch::Tensor& t_us,
                        const torch::Tensor& polarity) {
  const auto [sorted, order] = torch::sort(t_us, /*stable=*/true, 0, false);
  return {x.index_select(0, order), y.index_select(0, order), sorted,
          polarity.index_select(0, order)};
}

EventStream only_in(const std::vector<TimeWindow>& windows, const EventStream& events) {
  std::vector<EventStream> parts;
  int64_t count = 0;
  for (const TimeWindow& window : windows) {
    parts.push_back(events.slice(window));
    count += parts.back().size();
  }
  if (parts.empty()) return {};
  const int64_t begin = events.count_before(windows.front().begin_us);
  const int64_t end = events.count_before(windows.back().end_us);
  if (count == end - begin) return events.range(begin, end);
  const auto joined = [&](const torch::Tensor& (EventStream::*list)() const) {
    std::vector<torch::Tensor> pieces;
    for (const EventStream& part : parts) pieces.push_back((part.*list)());
    return torch::cat(pieces);
  };
  return {joined(&EventStream::x), joined(&EventStream::y), joined(&EventStream::t_us),
          joined(&EventStream::polarity)};
}

void check_memory(const std::string& what, double bytes, const std::string& fix) {
  const double machine = machine_memory();
  if (bytes < kMostMemory * machine) return;
  const auto gigabytes = [](double count) { return 0.1 * std::round(1e-8 * count); };
  throw DataError(concat(what, " need ", gigabytes(bytes), " GB, more than ", kMostMemory,
                         " of the ", gigabytes(machine), " GB of this machine; ", fix));
}

void check_event_memory(const std::filesystem::path& path, int64_t count, double bytes) {
  check_memory(concat(path.string(), ": ", count, " events"), bytes * double(count));
}

std::string event_group_name(const std::filesystem::path& path, const std::string& group) {
  return Hdf5Events(path, group).name();
}

EventFileResult read_events(const std::filesystem::path& path, const EventFileOptions& options) {
  EventFileResult result;
  RawEvents raw = wanted_events(path, options, result);
  if (!raw.note.empty()) result.warnings.push_back(raw.note);
  make_signs(path, raw.polarity);
  TimeRange range = range_of(path, raw.time);
  // Counts are unwrapped before their unit is known; in decimal fractions the counts are µs.
  if (!range.has_fraction && continue_counter(path, raw.time, result)) {
    range = range_of(path, raw.time);
  }
  result.time_unit = chosen_unit(path, range, raw.unit, options);
  if (options.time_unit == TimeUnit::kAuto && raw.unit == TimeUnit::kAuto) {
    const std::string doubt = milliseconds_warning(path, raw.time, result.time_unit);
    if (!doubt.empty()) result.warnings.push_back(doubt);
    const std::optional<TimeUnit> usual =
        guess_time_unit(range.usual_first, range.usual_last, range.has_fraction, std::nullopt);
    if (result.time_unit == TimeUnit::kMs ||
        (!options.exposures && result.time_unit != usual && range.count > 0)) {
      result.warnings.push_back(concat(path.string(), ": event times are read as ",
                                       name_of(result.time_unit),
                                       ", the only unit in which they cover the frames; if they ",
                                       "have another, name it in the column: t_us"));
    }
  }
  if (raw.time.numel() > 0) {
    check_resolution(path, range.first, range.last, raw.time.numel(), raw.time_bits,
                     result.time_unit);
    if (options.most == 0 || raw.time.numel() < options.most) {
      check_digits(path, raw.time, result.time_unit);
    }
  }
  result.sensor = raw.size;
  raw.time = to_us(raw.time, result.time_unit);
  if (range.has_fraction) continue_counter(path, raw.time, result);
  const ClockOrder order = order_of(raw.time);
  result.was_unsorted = !order.sorted();
  if (result.was_unsorted) {
    result.warnings.push_back(concat(path.string(), ": ", order.fault()));
    result.events = sort_events(raw.x, raw.y, raw.time, raw.polarity);
  } else {
    result.events = EventStream(raw.x, raw.y, raw.time, raw.polarity);
  }
  const int64_t all_read = result.events.size();
  if (std::string strays = drop_strays(result.events); !strays.empty())
    result.warnings.push_back(concat(path.string(), ": ", strays));
  result.stored -= all_read - result.events.size();
  if (result.stored_us.duration_us() == 0 && !result.events.empty()) {
    result.stored_us = {result.events.first_us(), result.events.last_us() + 1};
  }
  const bool guessed = options.time_unit == TimeUnit::kAuto && raw.unit == TimeUnit::kAuto;
  if (guessed && options.exposures &&
      result.time_unit !=
          guess_time_unit(range.usual_first, range.usual_last, range.has_fraction, std::nullopt)) {
    check_unusual(path, result, *options.exposures);
  }
  if (guessed && options.exposures && options.most == 0) {
    check_guess(path, result, *options.exposures);
    const std::string hint =
        other_unit(range.usual_first, range.usual_last, result.time_unit, *options.exposures);
    if (!hint.empty()) {
      result.warnings.push_back(
          concat(path.string(), ": expected events about as long as the exposures, found ",
                 readable(1e-6 * double(result.stored_us.duration_us()), 3), " s of them, read as ",
                 word_of(result.time_unit), "; ", hint));
    }
  }
  drop_copies(path, result);
  const std::string alone = lone_event_warning(path, result.events.t_us(), !result.was_unsorted);
  if (!alone.empty()) result.warnings.push_back(alone);
  if (options.keep) result.events = only_in(*options.keep, result.events);
  if (const int64_t bad = count_problems(result.events, {}).not_finite; bad > 0) {
    result.warnings.push_back(concat(path.string(), ": ", bad, " of ", result.events.size(),
                                     " events have NaN or Inf coordinates and are ignored"));
  }
  if (result.stored == 0) result.warnings.push_back(concat(path.string(), ": holds no events"));
  return result;
}

}  // namespace jade::events
