// SPDX-License-Identifier: Apache-2.0
#include "jade/events/stream_faults.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::events {
namespace {

/// Smaller steps back are the disorder of packets.
constexpr double kJumpUs = 10000;
/// Share of a step back that one step ahead beside it undoes if a single time is damaged.
constexpr double kUndone = 0.9;

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
