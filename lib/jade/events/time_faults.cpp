// SPDX-License-Identifier: Apache-2.0
#include "jade/events/time_faults.h"

#include <ATen/ops/_unique.h>
#include <algorithm>
#include <cmath>
#include <tuple>

#include "jade/core/error.h"

namespace jade::events {

int significant_bits(bool floating, int64_t bytes) {
  if (!floating) return 64;
  return bytes <= 2 ? 11 : bytes <= 4 ? 24 : 53;
}

WrappedCounter unwrap_counter(torch::Tensor& times) {
  int64_t* const t = times.mutable_data_ptr<int64_t>();
  const int64_t count = times.numel();
  if (count < 2 || std::is_sorted(t, t + count)) return {};
  const auto [low, high] = std::minmax_element(t, t + count);
  const double span = double(*high) - double(*low);
  for (const int bits : {16, 24, 31, 32}) {
    const int64_t all = int64_t(1) << bits;
    const int64_t nearly_all = all - all / 64, jitter = all / 256;
    if (span >= double(all) || span < double(nearly_all)) continue;
    int64_t wraps = 0;
    bool is_counter = true;
    for (int64_t i = 1; i < count && is_counter; ++i) {
      const int64_t back = t[i - 1] - t[i];
      if (back >= nearly_all) ++wraps;
      // An event from before the wrap may be stored after it.
      if (-back >= nearly_all) --wraps;
      is_counter = back < jitter || back >= nearly_all;
    }
    if (!is_counter || wraps < 1) continue;
    int64_t before = t[0], offset = 0;
    for (int64_t i = 1; i < count; ++i) {
      const int64_t now = t[i];
      if (before - now >= nearly_all) offset += all;
      if (now - before >= nearly_all) offset -= all;
      t[i] = now + offset;
      before = now;
    }
    return {bits, wraps};
  }
  return {};
}

void check_resolution(const std::filesystem::path& path, double smallest, double largest,
                      int64_t count, int bits, TimeUnit unit) {
  constexpr double kCoarsestUs = 1000;
  constexpr int64_t kMany = 100;  // events
  constexpr double kFew = 16;     // values of the type
  const double size = std::max(std::abs(smallest), std::abs(largest));
  if (bits > 53 || size == 0 || !std::isfinite(size)) return;
  const double step = std::ldexp(1.0, std::ilogb(size) - bits + 1);
  const double step_us = step * us_per_unit(unit);
  const bool crowded = step_us > 1 && count >= kMany && largest - smallest <= kFew * step;
  if (step_us <= kCoarsestUs && !crowded) return;
  throw DataError(concat(path.string(), ": expected event times at most 1 ms apart, found float",
                         bits == 53   ? 64
                         : bits == 24 ? 32
                                      : 16,
                         " times near ", size, ", where the type has a value every ", step,
                         "; store the times as float64 or as integers, from the recording's own "
                         "source"));
}

namespace {

/// Whole numbers that were rounded to float32 on their way, at a rate that no camera sends.
void check_rounding(const std::filesystem::path& path, const torch::Tensor& time, TimeUnit unit) {
  constexpr double kMostPerSecond = 1e7;
  const auto [least, most] = time.aminmax();
  const double low = least.to(torch::kFloat64).item<double>();
  const double high = most.to(torch::kFloat64).item<double>();
  const double largest = std::max(std::abs(low), std::abs(high));
  if (largest < std::ldexp(1.0, 25)) return;  // float32 holds whole numbers up to 2^24
  const double span_us = (high - low) * us_per_unit(unit);
  if (span_us == 0 || 1e6 * double(time.numel()) <= kMostPerSecond * span_us) return;
  const torch::Tensor value = time.to(torch::kFloat64);
  if (!value.eq(value.to(torch::kFloat32).to(torch::kFloat64)).all().item<bool>()) return;
  throw DataError(concat(path.string(), ": found ", time.numel(), " event times near ", largest,
                         ", all of which float32 can hold, one every ",
                         std::ldexp(1.0, std::ilogb(largest) - 23),
                         ": digits were lost; write the times again from the recording's own "
                         "source, as float64 or as integers"));
}

}  // namespace

void check_digits(const std::filesystem::path& path, const torch::Tensor& time, TimeUnit unit) {
  constexpr int64_t kTelling = 1000;  // events
  constexpr double kCoarsestUs = 1000, kLongUs = 100000;
  constexpr int64_t kFew = 16, kCrowd = 50;  // times; events at each
  if (time.numel() < kTelling) return;
  check_rounding(path, time, unit);
  // Stop when two times are closer than this: usually the first two that differ.
  const double close = kCoarsestUs / us_per_unit(unit);
  const auto has_close_times = [&](const auto* t) {
    for (int64_t i = 1; i < time.numel(); ++i) {
      if (t[i] != t[i - 1] && std::abs(double(t[i]) - double(t[i - 1])) < close) return true;
    }
    return false;
  };
  if (time.is_floating_point() ? has_close_times(time.const_data_ptr<double>())
                               : has_close_times(time.const_data_ptr<int64_t>())) {
    return;
  }
  const torch::Tensor distinct = std::get<0>(at::_unique(time, /*sorted=*/true));
  const int64_t count = distinct.numel();
  double apart = 0;
  if (count > 1) {
    apart = distinct.diff().min().to(torch::kFloat64).item<double>();
    const double apart_us = apart * us_per_unit(unit);
    const bool is_coarse = apart_us >= kLongUs || (apart_us >= kCoarsestUs && count <= kFew);
    if (!is_coarse || time.numel() < kCrowd * count) return;
  }
  throw DataError(concat(path.string(), ": expected event times at most 1 ms apart, found ",
                         time.numel(), " events at ", count, count == 1 ? " time" : " times",
                         count == 1 ? "" : concat(", ", apart, " or more apart"), " (the first ",
                         distinct[0].to(torch::kFloat64).item<double>(),
                         "): digits were lost; write the times as integers in us or ns, or with "
                         "six decimals and more"));
}

std::string milliseconds_warning(const std::filesystem::path& path, const torch::Tensor& time,
                                 TimeUnit guessed) {
  constexpr int64_t kTelling = 1000;            // events
  constexpr double kFewest = 1e4, kMost = 1e8;  // events per second
  constexpr double kNearlyWhole = 1e-3;
  const int64_t count = time.numel();
  if (count < kTelling || (guessed != TimeUnit::kS && guessed != TimeUnit::kUs)) return "";
  const auto [low, high] = time.aminmax();
  const double span = (high - low).item<double>();
  const double rate = 1e6 * double(count) / (span * us_per_unit(guessed));
  if (!(span > 0) || (guessed == TimeUnit::kS ? rate >= kFewest : rate <= kMost)) return "";
  const torch::Tensor ms = time.to(torch::kFloat64) * (guessed == TimeUnit::kS ? 1e3 : 1.0);
  if (!((ms - ms.round()).abs() < kNearlyWhole).all().item<bool>()) return "";
  return concat(path.string(), ": ", count, " events within ", span,
                guessed == TimeUnit::kS ? " s, none between two milliseconds," : " us",
                " look like times in milliseconds; if they are, name that column t_ms");
}

Stretch without_strays(int64_t count, const std::vector<double>& head,
                       const std::vector<double>& tail, double second) {
  constexpr int64_t kTelling = 100, kRarest = 1000, kLeast = 3;
  constexpr double kLongS = 10;
  Stretch kept{0, count};
  if (count < kTelling) return kept;
  const auto most = size_t(std::clamp(count / kRarest, kLeast, kMostStrays));
  const auto from_end = [&](size_t i) { return tail[tail.size() - 1 - i]; };
  const double pause = std::max(from_end(most) - head[most], kLongS * second);
  for (size_t i = 0; i < most; ++i) {
    if (head[i + 1] - head[i] > pause) kept.begin = int64_t(i) + 1;
    if (from_end(i) - from_end(i + 1) > pause) kept.end = count - 1 - int64_t(i);
  }
  return kept;
}

std::string strays_warning(const Stretch& kept, int64_t count) {
  const int64_t strays = count - kept.size();
  if (strays == 0) return "";
  return concat("expected one recording, found ", strays, strays == 1 ? " event" : " events",
                " far from the other ", kept.size(), " (", kept.begin, " before, ",
                count - kept.end, " after), as damaged times cause; ",
                strays == 1 ? "it is" : "they are", " left out");
}

std::string lone_event_warning(const std::filesystem::path& path, const torch::Tensor& t_us,
                               bool was_sorted) {
  constexpr double kDayUs = 86400e6, kLongUs = 600e6, kNearlyAll = 0.9;
  const int64_t count = t_us.numel();
  if (count < 2) return "";
  const int64_t* const t = t_us.const_data_ptr<int64_t>();
  const double span = double(t[count - 1]) - double(t[0]);
  if (span < (was_sorted ? kDayUs : kLongUs)) return "";
  for (int64_t i = 1; i < count; ++i) {
    const double gap = double(t[i]) - double(t[i - 1]);
    if (gap < kNearlyAll * span) continue;
    return concat(path.string(), ": expected one recording, found ", i, " events, then none for ",
                  1e-6 * gap, " s, then ", count - i,
                  " events; check the times for damaged values or a counter that wrapped");
  }
  return "";
}

}  // namespace jade::events
