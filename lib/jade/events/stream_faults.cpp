// SPDX-License-Identifier: Apache-2.0
#include "jade/events/stream_faults.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>
#include <torch/types.h>
#include <tuple>

#include "jade/core/error.h"
#include "jade/core/median.h"
#include "jade/core/readable.h"
#include "jade/events/time_faults.h"

namespace jade::events {
namespace {

/// Smaller steps back are the disorder of packets.
constexpr double kJumpUs = 10000;
/// Share of a step back that one step ahead beside it undoes if a single time is damaged.
constexpr double kUndone = 0.9;

void sort_by_time(std::vector<NamedWindow>& exposures) {
  std::stable_sort(exposures.begin(), exposures.end(), [](const auto& a, const auto& b) {
    return std::pair(a.window.begin_us, a.window.end_us) <
           std::pair(b.window.begin_us, b.window.end_us);
  });
}

double ms(int64_t us) { return 1e-3 * double(us); }

constexpr const char* kWriteAgain =
    "write the times again as whole microseconds, or as seconds with six decimals";

}  // namespace

std::string polarity_fault(const EventStream& events) {
  constexpr int64_t kFew = 100;      // fewer events are inconclusive
  constexpr int64_t kRarest = 1000;  // least share of a polarity, one in this many
  const int64_t all = events.size();
  if (all < kFew) return "";
  const int64_t up = events.polarity().gt(0).sum().item<int64_t>();
  if (std::min(up, all - up) * kRarest >= all) return "";
  return concat(up, " of ", all, " events are of getting brighter, ", all - up,
                " of getting darker; expected some of both: 1 and 0, or 1 and -1. Does the file "
                "hold one polarity only?");
}

std::string drop_strays(EventStream& events) {
  constexpr double kSecondUs = 1e6;
  const int64_t* const t = events.t_us().const_data_ptr<int64_t>();
  const int64_t all = events.size(), some = std::min(all, kMostStrays + 1);
  const Stretch kept = without_strays(all, std::vector<double>(t, t + some),
                                      std::vector<double>(t + all - some, t + all), kSecondUs);
  if (kept.size() < all) events = events.range(kept.begin, kept.end);
  return strays_warning(kept, all);
}

std::string resolution_fault(const EventStream& events) {
  constexpr int64_t kFew = 1000;                // fewer events are inconclusive
  constexpr int64_t kCrowd = 8;                 // events at each time, on average
  constexpr int64_t kCoarsestUs = 500;          // harmless in exposures of 5 ms and more
  constexpr size_t kTelling = size_t(1) << 17;  // distinct times
  const int64_t* const t = events.t_us().const_data_ptr<int64_t>();
  std::vector<int64_t> gaps;
  int64_t seen = 1;
  for (; seen < events.size() && gaps.size() < kTelling; ++seen) {
    if (t[seen] != t[seen - 1]) gaps.push_back(t[seen] - t[seen - 1]);
  }
  if (seen < kFew || gaps.empty() || seen < kCrowd * int64_t(gaps.size() + 1)) return "";
  const int64_t step = median_of(gaps);
  if (step < kCoarsestUs) return "";
  return concat("expected event times in microseconds, found ", seen, " events at ",
                gaps.size() + 1, " times, which are ", ms(step),
                " ms apart: digits were lost, and motion within these steps; ", kWriteAgain);
}

namespace {

/// Least range of the starts about a line with nearly this slope: rounded times of a steady camera
/// stay within one step of rounding.
template <class PeriodsOf>
double spread_about_line(const std::vector<TimeWindow>& exposures, double period,
                         const PeriodsOf& periods_of, double step) {
  constexpr int kSlopes = 10;  // to either side
  double least = INFINITY;
  for (int k = -kSlopes; k <= kSlopes; ++k) {
    const double slope = period + step * k / (kSlopes * double(exposures.size()));
    double lowest = 0, highest = 0, expected = 0;
    for (size_t i = 1; i < exposures.size(); ++i) {
      expected += slope * double(periods_of(exposures[i].begin_us - exposures[i - 1].begin_us));
      const double off = double(exposures[i].begin_us - exposures[0].begin_us) - expected;
      lowest = std::min(lowest, off), highest = std::max(highest, off);
    }
    least = std::min(least, highest - lowest);
  }
  return least;
}

}  // namespace

std::string resolution_fault(std::vector<TimeWindow> exposures) {
  constexpr size_t kFew = 6;  // frames
  constexpr int64_t kCoarsestUs = 1000;
  constexpr double kShare = 0.05;     // of the exposure
  constexpr double kLargest = 0.45;   // of the period
  constexpr double kFrequent = 0.15;  // of the gaps
  if (exposures.size() < kFew) return "";
  std::sort(exposures.begin(), exposures.end(),
            [](const TimeWindow& a, const TimeWindow& b) { return a.begin_us < b.begin_us; });
  std::vector<int64_t> gaps, lengths;
  int64_t step = 0;
  for (size_t i = 0; i < exposures.size(); ++i) {
    if (exposures[i].duration_us() > 0) lengths.push_back(exposures[i].duration_us());
    if (i == 0) continue;
    gaps.push_back(exposures[i].begin_us - exposures[i - 1].begin_us);
    step = std::gcd(step, gaps.back());
  }
  const int64_t usual = median_of(gaps);
  if (step < kCoarsestUs || step >= usual) return "";
  // A steady camera, whose rounded times differ from its period; it may leave out frames.
  const auto periods_of = [&](int64_t gap) {
    // A gap of one and a half periods is one period; the next gap has the other half.
    return std::max<int64_t>(1, int64_t(std::ceil(double(gap) / double(usual) - 0.5)));
  };
  int64_t periods = 0;
  for (const int64_t gap : gaps) periods += periods_of(gap);
  const double period =
      double(exposures.back().begin_us - exposures.front().begin_us) / double(periods);
  const bool exact = std::all_of(gaps.begin(), gaps.end(),
                                 [&](int64_t gap) { return gap == periods_of(gap) * usual; });
  if (exact || spread_about_line(exposures, period, periods_of, double(step)) >= double(step))
    return "";
  // A large step may be a pause; that of rounding is frequent.
  const auto odd = std::count_if(gaps.begin(), gaps.end(),
                                 [&](int64_t gap) { return gap != periods_of(gap) * usual; });
  if (double(step) > kLargest * period && double(odd) < kFrequent * double(gaps.size())) return "";
  const int64_t length = lengths.empty() ? usual : median_of(lengths);
  if (double(step) <= kShare * double(length)) return "";
  return concat("expected frame times in microseconds, found all of ", exposures.size(),
                " in steps of ", ms(step), " ms, at a frame period of ", ms(std::llround(period)),
                " ms: digits were lost, and exposures may be wrong by half a step; ", kWriteAgain);
}

namespace {

/// Mean step between distinct times, without pauses.
double usual_step_us(const EventStream& events) {
  constexpr double kPause = 20;  // mean steps
  const int64_t* const t = events.t_us().const_data_ptr<int64_t>();
  int64_t steps = 0;
  for (int64_t i = 1; i < events.size(); ++i) steps += t[i] != t[i - 1] ? 1 : 0;
  if (steps == 0) return 0;
  const double longest = kPause * double(t[events.size() - 1] - t[0]) / double(steps);
  double active_us = 0;
  for (int64_t i = 1; i < events.size(); ++i) {
    const double step = double(t[i] - t[i - 1]);
    active_us += step <= longest ? step : 0;
  }
  return active_us / double(steps);
}

}  // namespace

std::vector<TimeWindow> silences(const EventStream& events) {
  constexpr size_t kBeside = 24;       // distinct times at each end
  constexpr int64_t kShortest = 1000;  // us
  constexpr double kSlower = 3;  // steps at the ends, of usual ones: motion that comes to rest
  const double longest_us = kSlower * double(kBeside) * usual_step_us(events);
  const auto is_dense = [&](int64_t span_us, int64_t gap_us) {
    return span_us < gap_us && double(span_us) <= longest_us;
  };
  const int64_t* const t = events.t_us().const_data_ptr<int64_t>();
  std::array<int64_t, kBeside> last{};  // distinct times, a ring
  size_t seen = 0;
  struct Open {
    TimeWindow silence;
    size_t end;  ///< number of distinct times when it can be judged
  };
  std::vector<Open> open;
  std::vector<TimeWindow> found;
  for (int64_t i = 0; i < events.size(); ++i) {
    if (seen > 0 && t[i] == last[(seen - 1) % kBeside]) continue;
    const int64_t gap = seen > 0 ? t[i] - last[(seen - 1) % kBeside] : 0;
    const bool is_dense_before =
        seen >= kBeside && is_dense(last[(seen - 1) % kBeside] - last[seen % kBeside], gap);
    if (gap >= kShortest && is_dense_before) open.push_back({{t[i] - gap, t[i]}, seen + kBeside});
    last[seen++ % kBeside] = t[i];
    if (open.empty() || open.front().end != seen) continue;
    const TimeWindow silence = open.front().silence;
    open.erase(open.begin());
    if (is_dense(t[i] - silence.end_us, silence.duration_us())) found.push_back(silence);
  }
  return found;
}

std::string silence_fault(const std::vector<NamedWindow>& exposures,
                          const std::vector<TimeWindow>& silences) {
  constexpr double kLeastOfOne = 0.05, kLeastOfAll = 0.02;  // of the length of exposures
  double silent_us = 0, exposed_us = 0, largest_share = 0;
  int64_t count = 0, longest_us = 0;
  std::string place;
  for (const auto& [name, exposure] : exposures) {
    exposed_us += double(exposure.duration_us());
    for (const TimeWindow& silence : silences) {
      const int64_t begin = std::max(silence.begin_us, exposure.begin_us);
      const int64_t length = std::min(silence.end_us, exposure.end_us) - begin;
      if (length <= 0) continue;
      ++count;
      silent_us += double(length);
      largest_share = std::max(largest_share, double(length) / double(exposure.duration_us()));
      if (length <= longest_us) continue;
      longest_us = length;
      place = concat("in ", name, ", ", 1e-3 * double(length), " ms from ", begin, " us");
    }
  }
  if (count == 0 || (largest_share < kLeastOfOne && silent_us < kLeastOfAll * exposed_us))
    return "";
  return concat("expected events throughout the exposures, found ", count,
                count == 1 ? " stretch" : " stretches", " without any, ",
                0.1 * std::round(1000 * silent_us / exposed_us), " % of the exposed time (",
                count == 1 ? "" : "the longest ", place,
                "), between dense events, as lost packets leave them");
}

std::string place_fault(const EventStream& events) {
  constexpr int64_t kFew = 1000;
  constexpr double kNearlyAll = 0.99, kMany = 0.25;  // rectified events leave the image
  if (events.size() < kFew) return "";
  const auto share = [&](const torch::Tensor& which) {
    return which.sum().item<double>() / double(events.size());
  };
  const auto in_unit = [&](const torch::Tensor& places) {
    return share(places.ge(0).logical_and(places.le(1))) > kNearlyAll &&
           share(places.frac().ne(0)) > 0.5;
  };
  if (in_unit(events.x()) && in_unit(events.y())) {
    return "expected event places in pixels, found x and y from 0 to 1; if they are normalised, "
           "multiply x by the sensor's width and y by its height";
  }
  std::string found;
  for (const auto& [name, places] : {std::pair("x", events.x()), std::pair("y", events.y())}) {
    const double below = share(places.lt(-0.5));
    if (below <= kMany) continue;
    found += concat(found.empty() ? "" : " and ", name, " below 0 in ", std::round(100 * below),
                    " % of the events, down to ", places.nan_to_num().min().item<double>());
  }
  if (found.empty()) return "";
  return concat("expected event places from 0 at the upper left pixel, found ", found,
                "; add an offset, so that they begin at 0");
}

std::string one_based_fault(const EventStream& events, const ImageSize& size) {
  constexpr int64_t kFewest = 10;  // events in the row, and in the column, beyond the last
  const torch::Tensor x = events.x().round(), y = events.y().round();
  const auto count = [](const torch::Tensor& which) { return which.sum().item<int64_t>(); };
  const int64_t columns = count(x == double(size.width)), rows = count(y == double(size.height));
  if (columns < kFewest || rows < kFewest || count(x <= 0) > 0 || count(y <= 0) > 0) return "";
  if (count(x > double(size.width)) > 0 || count(y > double(size.height)) > 0) return "";
  return concat("expected event coordinates from 0 to ", size.width - 1, " and ", size.height - 1,
                ", found 1 to ", size.width, " and ", size.height,
                ": they count from 1; subtract 1 from x and y");
}

namespace {

/// Share of the events that repeat the place, time and polarity of another one, from a sample.
double repeated_share(const EventStream& events) {
  constexpr int64_t kPieces = 64, kPiece = 16384, kBefore = 64;
  const float *x = events.x().const_data_ptr<float>(), *y = events.y().const_data_ptr<float>();
  const int64_t* t = events.t_us().const_data_ptr<int64_t>();
  const int8_t* p = events.polarity().const_data_ptr<int8_t>();
  const int64_t step = std::max(kPiece, events.size() / kPieces);
  int64_t looked = 0, repeated = 0;
  for (int64_t begin = 0; begin < events.size(); begin += step) {
    const int64_t end = std::min(begin + kPiece, events.size());
    for (int64_t i = begin; i < end; ++i) {
      ++looked;
      for (int64_t j = i - 1; j >= std::max<int64_t>(0, i - kBefore) && t[j] == t[i]; --j) {
        if (x[j] != x[i] || y[j] != y[i] || p[j] != p[i]) continue;
        ++repeated;
        break;
      }
    }
  }
  return double(repeated) / double(std::max<int64_t>(1, looked));
}

}  // namespace

DistinctEvents without_copies(const EventStream& events) {
  constexpr int64_t kPart = 4096, kFewest = 100, kTelling = 1000;
  constexpr double kNearlyAll = 0.9, kMany = 0.05;
  const int64_t count = events.size();
  const double share = count < kTelling ? 0 : repeated_share(events);
  if (share <= kMany) return {events, 0, ""};
  const float *x = events.x().const_data_ptr<float>(), *y = events.y().const_data_ptr<float>();
  const int64_t* const t = events.t_us().const_data_ptr<int64_t>();
  const int8_t* const p = events.polarity().const_data_ptr<int8_t>();
  const auto place = [&](int64_t i) { return std::make_tuple(x[i], y[i], p[i]); };
  std::vector<bool> copied(size_t(count), false);
  std::vector<int64_t> same;  // events at one time
  int64_t part = 0, distinct = 0, repeated = 0, copies = 0;
  for (int64_t begin = 0, end = 0; begin < count; begin = end) {
    while (end < count && t[end] == t[begin]) ++end;
    same.resize(size_t(end - begin));
    std::iota(same.begin(), same.end(), begin);
    std::sort(same.begin(), same.end(), [&](int64_t a, int64_t b) { return place(a) < place(b); });
    for (size_t i = 0, next = 0; i < same.size(); i = next) {
      for (next = i + 1; next < same.size() && place(same[next]) == place(same[i]); ++next)
        copied[size_t(same[next])] = true;
      ++distinct, repeated += next - i > 1 ? 1 : 0;
    }
    if (end - part < kPart && end < count) continue;
    if (distinct >= kFewest && double(repeated) >= kNearlyAll * double(distinct)) {
      copies += end - part - distinct;
    } else {
      std::fill(copied.begin() + part, copied.begin() + end, false);
    }
    part = end, distinct = repeated = 0;
  }
  const std::string fault =
      copies > 0
          ? concat("expected each event once, found ", grouped(copies), " of ", grouped(count),
                   " that repeat the time, place and polarity of another; "
                   "these are left out, check how the file was written or joined")
          : concat("expected each event once, found ", std::round(100 * share),
                   " % that repeat the time, place and polarity of another, here and there; "
                   "the thresholds come out too small; keep each event once");
  if (copies == 0) return {events, 0, fault};
  torch::Tensor kept = torch::empty({count}, torch::kBool);
  std::transform(copied.begin(), copied.end(), kept.mutable_data_ptr<bool>(), std::logical_not());
  return {events.select(kept), copies, fault};
}

int64_t frame_period_us(const std::vector<NamedWindow>& exposures) {
  std::vector<int64_t> starts;
  for (const NamedWindow& exposure : exposures) starts.push_back(exposure.window.begin_us);
  std::sort(starts.begin(), starts.end());
  return median_step(starts);
}

std::string overlap_fault(const std::string& path, std::vector<NamedWindow> exposures) {
  constexpr double kLargestOverlap = 0.05;  // of the frame period
  constexpr double kMostOverlapping = 0.1;  // of the exposures, for example after a late time stamp
  if (exposures.size() < 2) return "";
  sort_by_time(exposures);
  const int64_t period_us = frame_period_us(exposures);
  size_t overlapping = 0, first = 0;
  for (size_t i = 1; i < exposures.size(); ++i) {
    const TimeWindow &a = exposures[i - 1].window, &b = exposures[i].window;
    if (a.begin_us == b.begin_us && a.end_us == b.end_us) {
      throw DataError(concat(path, ": expected an exposure of its own for each frame, found ",
                             exposures[i - 1].name, " and ", exposures[i].name,
                             " both exposed from ", a.begin_us, " to ", a.end_us,
                             " us; correct the times"));
    }
    if (double(a.end_us - b.begin_us) <= kLargestOverlap * double(period_us)) continue;
    if (overlapping++ == 0) first = i;
  }
  if (overlapping == 0) return "";
  const NamedWindow &a = exposures[first - 1], &b = exposures[first];
  const std::string found =
      concat(path, ": expected exposures that end before the next begins, found ", overlapping,
             " of ", exposures.size(), " that overlap, as ", a.name, " (until ", a.window.end_us,
             " us) and ", b.name, " (from ", b.window.begin_us, " us), at a frame period of ",
             period_us, " us; correct their lengths");
  if (double(overlapping) > kMostOverlapping * double(exposures.size())) throw DataError(found);
  return found;
}

void ClockOrder::add(int64_t t_us) {
  const double ahead_us = count_ == 0 ? 0 : double(t_us) - double(before_us_);
  if (is_open_ && ahead_us < kUndone * open_.back_us()) keep(open_);
  is_open_ = ahead_us < -kJumpUs && ahead_us_ < -kUndone * ahead_us;
  if (is_open_) open_ = {count_, before_us_, t_us};
  if (ahead_us < 0) ++backwards_;
  ahead_us_ = ahead_us;
  before_us_ = t_us;
  ++count_;
}

void ClockOrder::keep(const Step& step) {
  ++jumps_;
  if (jumps_ == 1 || step.back_us() > largest_.back_us()) largest_ = step;
}

std::string ClockOrder::fault() const {
  if (sorted()) return "";
  if (jumps_ == 0) return "event times were not in order; they have been sorted";
  return concat("event times go back by ", 1e-6 * largest_.back_us(), " s at event ",
                largest_.index, " of ", count_, ", from ", largest_.from_us, " to ", largest_.to_us,
                " us", jumps_ == 1 ? "" : concat(", the largest of ", jumps_, " such jumps"),
                "; they have been sorted, which mixes the parts before and after: if the clock "
                "was restarted, split the file there");
}

}  // namespace jade::events
