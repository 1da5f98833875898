// SPDX-License-Identifier: Apache-2.0
#include "jade/events/time_unit.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <torch/types.h>
#include <tuple>

#include "jade/core/check.h"
#include "jade/core/text.h"

namespace jade::events {
namespace {

constexpr double kShortestUs = 10;
constexpr double kLongestUs = 5e6;
constexpr double kLatestUs = 4e18;  // differences of two such times fit an int64

/// How well events from `first` to `last` in this unit match the exposures: the share of exposures
/// with events, reduced if the two spans have different lengths. The first alone would always
/// prefer the largest unit for a clock that begins at 0; the second alone would reject long
/// recordings with few frames. Zero if they do not overlap.
double match_of(TimeUnit unit, double first, double last, const TimeWindow& exposures) {
  const double begin = first * us_per_unit(unit), end = last * us_per_unit(unit);
  const double since = double(exposures.begin_us), until = double(exposures.end_us);
  const double shared = std::min(end, until) - std::max(begin, since);
  if (shared < 0) return 0;
  const auto share_of = [&](double span) { return span > 0 ? (shared + 1e-9) / span : 1; };
  const double both = std::max(end, until) - std::min(begin, since);
  return share_of(until - since) * std::sqrt(share_of(both));
}

bool is_only_ns(const torch::Tensor& times) {
  return !times.is_floating_point() && times.numel() > 0 &&
         times.max().to(torch::kFloat64).item<double>() > kOnlyNs;
}

/// Whether floating-point times are whole numbers that are too far apart for frames in seconds.
bool is_whole_and_large(const torch::Tensor& times) {
  constexpr double kLongestGapS = 1000;
  if (times.numel() < 2) return false;
  const torch::Tensor t = times.to(torch::kFloat64);
  const auto [first, last] = t.aminmax();
  const double gap = (last - first).item<double>() / double(t.numel() - 1);
  return gap > kLongestGapS && t.eq(t.floor()).all().item<bool>();
}

/// Median time from one start to the next; 0 for fewer than three.
double period_of(const torch::Tensor& start) {
  if (start.numel() < 3) return 0;
  return std::get<0>(start.to(torch::kFloat64).sort()).diff().median().item<double>();
}

/// Unit of exposure times whose lengths do not determine it. Whole numbers are ns if their clock
/// counts from 1970, or if frames would be more than 5 s apart in µs.
TimeUnit lone_unit(const torch::Tensor& times) {
  constexpr double kLongestPeriodUs = 5e6;
  if (times.is_floating_point() && !is_whole_and_large(times)) return TimeUnit::kS;
  if (times.numel() == 0) return TimeUnit::kUs;
  const bool is_ns = times.max().to(torch::kFloat64).item<double>() > kOnlyNs ||
                     period_of(times) > kLongestPeriodUs;
  return is_ns ? TimeUnit::kNs : TimeUnit::kUs;
}

/// Whether cameras take frames of this length and period, both in ms.
bool is_ordinary_in_ms(double length, double period) {
  constexpr double kShortest = 0.1, kLongest = 1000, kFastest = 1, kSlowest = 5000;
  constexpr double kRounding = 1.05;
  return length >= kShortest && length <= kLongest && period >= kFastest && period <= kSlowest &&
         length <= kRounding * period;
}

/// Whether no frame camera beside an event sensor takes such frames, although `unit` allows their
/// length: more than 5,000 per second, or as is_too_slow().
bool is_implausible(TimeUnit unit, double length, double period) {
  if (unit == TimeUnit::kUs) return period < 200;
  return unit == TimeUnit::kS && is_too_slow(1e6 * length, 1e6 * period);
}

}  // namespace

bool is_too_slow(double length_us, double period_us) {
  return length_us > kLongestExposureUs || (length_us >= 5e5 && period_us >= 1e7);
}

std::optional<TimeUnit> unit_of_word(std::string word) {
  word = in_small_letters(word);
  // The two UTF-8 spellings of µ.
  for (const char* const micro : {"\xC2\xB5", "\xCE\xBC"}) {
    if (word.rfind(micro, 0) == 0) word.replace(0, 2, "u");
  }
  const auto is = [&](std::initializer_list<const char*> known) {
    return std::find(known.begin(), known.end(), word) != known.end();
  };
  if (is({"us", "usec", "usecs", "microsecond", "microseconds"})) return TimeUnit::kUs;
  if (is({"ns", "nsec", "nsecs", "nanosec", "nanosecond", "nanoseconds"})) return TimeUnit::kNs;
  if (is({"ms", "msec", "msecs", "millisecond", "milliseconds"})) return TimeUnit::kMs;
  if (is({"s", "sec", "secs", "second", "seconds"})) return TimeUnit::kS;
  return std::nullopt;
}

double us_per_unit(TimeUnit unit) {
  JADE_CHECK(unit != TimeUnit::kAuto, "unit of time: expected us, ns, ms or s, found auto");
  return unit == TimeUnit::kS    ? 1e6
         : unit == TimeUnit::kMs ? 1e3
         : unit == TimeUnit::kNs ? 1e-3
                                 : 1;
}

std::optional<TimeUnit> guess_time_unit(double first, double last, bool has_fraction,
                                        const std::optional<TimeWindow>& exposures) {
  const bool only_ns = !has_fraction && last > kOnlyNs;
  if (!exposures) return has_fraction ? TimeUnit::kS : only_ns ? TimeUnit::kNs : TimeUnit::kUs;
  std::optional<TimeUnit> best;
  double best_match = 0;
  for (const TimeUnit unit : {TimeUnit::kUs, TimeUnit::kNs, TimeUnit::kS}) {
    if (only_ns && unit != TimeUnit::kNs) continue;
    const double match = match_of(unit, first, last, *exposures);
    if (match > best_match) best = unit, best_match = match;
  }
  constexpr double kPoor = 0.1, kGood = 0.5;
  const bool can_be_ms = !only_ns && best_match < kPoor;
  if (can_be_ms && match_of(TimeUnit::kMs, first, last, *exposures) > kGood) return TimeUnit::kMs;
  return best;
}

std::optional<TimeUnit> unit_by_length(double first, double last, TimeUnit unit,
                                       const TimeWindow& exposures) {
  constexpr double kShortest = 0.8, kLongest = 1.5, kMuch = 100;
  const double exposed_us = double(exposures.duration_us());
  if (!(exposed_us > 0)) return std::nullopt;
  const auto ratio_in = [&](TimeUnit other) {
    return (last - first) * us_per_unit(other) / exposed_us;
  };
  const double found = unit == TimeUnit::kAuto ? 0 : ratio_in(unit);
  if (found > 1 / kMuch && found < kMuch) return std::nullopt;
  for (const TimeUnit other : {TimeUnit::kUs, TimeUnit::kNs, TimeUnit::kS, TimeUnit::kMs}) {
    const double ratio = ratio_in(other);
    if (other != unit && ratio >= kShortest && ratio <= kLongest) return other;
  }
  return std::nullopt;
}

TimeUnit unit_beside_frames(double first, double last, bool has_fraction, int64_t count,
                            const TimeWindow& frames) {
  constexpr double kPoor = 0.1, kGood = 0.5;
  constexpr int64_t kTelling = 100;
  constexpr double kSlow = 1e4, kSlowest = 1e3, kFastest = 1e8;  // events per second
  const auto usual = *guess_time_unit(first, last, has_fraction, std::nullopt);
  const auto best = guess_time_unit(first, last, has_fraction, frames);
  if (!best || *best == usual || count < kTelling || !(last > first)) return usual;
  const auto match = [&](TimeUnit unit) { return match_of(unit, first, last, frames); };
  const auto rate = [&](TimeUnit unit) {
    return 1e6 * double(count) / ((last - first) * us_per_unit(unit));
  };
  const bool covers = match(*best) > kGood && match(usual) < kPoor;
  const bool odd = rate(usual) < kSlow || rate(usual) > kFastest;
  const bool ordinary = rate(*best) >= kSlowest && rate(*best) <= kFastest;
  return covers && odd && ordinary ? *best : usual;
}

TimeUnit guess_exposure_unit(const torch::Tensor& start, const torch::Tensor& end,
                             const std::string& name, const std::string& mend) {
  if (is_only_ns(start)) return TimeUnit::kNs;
  const bool floating = start.is_floating_point();
  torch::Tensor lengths = (end - start).to(torch::kFloat64);
  lengths = lengths.masked_select(lengths > 0);
  if (lengths.numel() == 0) return lone_unit(start);
  const double median = lengths.median().item<double>(), period = period_of(start);
  const bool can_be_ms = is_ordinary_in_ms(median, period);
  for (const TimeUnit unit : {TimeUnit::kUs, TimeUnit::kNs, TimeUnit::kS}) {
    if (unit == TimeUnit::kS && !floating) continue;
    const double us = median * us_per_unit(unit);
    if (us < kShortestUs || us > kLongestUs) continue;
    // Exposures of milliseconds in ns have a length that µs allow too; their period is the sign.
    if (unit == TimeUnit::kUs && is_too_slow(median, period)) continue;
    return can_be_ms && is_implausible(unit, median, period) ? TimeUnit::kMs : unit;
  }
  if (can_be_ms) return TimeUnit::kMs;
  throw DataError(concat(name, ": the median exposure is ", median,
                         ", which is no plausible time in us, ns, ms or s; ", mend));
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
    // Integer division keeps nanoseconds since 1970, which a double would round.
    for (size_t i = 0; i < out.size(); ++i) {
      if (std::abs(double(value[i]) * factor) > kLatestUs) throw implausible(i, double(value[i]));
      out[i] = unit == TimeUnit::kNs   ? value[i] / 1000 + (value[i] % 1000 >= 500 ? 1 : 0)
               : unit == TimeUnit::kUs ? value[i]
                                       : static_cast<int64_t>(double(value[i]) * factor);
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

}  // namespace jade::events
