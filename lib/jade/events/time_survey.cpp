// SPDX-License-Identifier: Apache-2.0
#include "jade/events/time_survey.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "jade/core/interrupt.h"

namespace jade::events {
namespace {

constexpr int64_t kMarkEvery = int64_t(1) << 16;
constexpr int64_t kTimesAtOnce = 16 * kMarkEvery;

}  // namespace

TimeSurvey::TimeSurvey(int64_t count, Read read)
    : count_(count),
      read_(std::move(read)),
      smallest_(std::numeric_limits<double>::infinity()),
      largest_(-std::numeric_limits<double>::infinity()) {
  std::vector<double> times(size_t(std::min(count, kTimesAtOnce)));
  double before = -std::numeric_limits<double>::infinity();
  for (int64_t begin = 0; begin < count; begin += kTimesAtOnce) {
    throw_if_interrupted();
    const int64_t here = std::min(kTimesAtOnce, count - begin);
    read_(begin, here, times.data());
    for (int64_t i = 0; i < here; ++i) {
      const double t = times[size_t(i)];
      if (i % kMarkEvery == 0) marks_.push_back(t);
      sorted_ = sorted_ && t >= before;
      finite_ = finite_ && std::isfinite(t);
      has_fraction_ = has_fraction_ || t != std::floor(t);
      smallest_ = std::min(smallest_, t), largest_ = std::max(largest_, t);
      before = t;
    }
  }
}

void shorten(std::vector<Stretch>& stretches, int64_t most) {
  for (Stretch& stretch : stretches) {
    stretch.end = std::min(stretch.end, stretch.begin + most);
    most -= stretch.size();
  }
}

int64_t TimeSurvey::first_at_or_after(double time) const {
  const auto mark = std::lower_bound(marks_.begin(), marks_.end(), time);
  if (mark == marks_.begin()) return 0;
  const int64_t begin = (mark - marks_.begin() - 1) * kMarkEvery;
  std::vector<double> times(size_t(std::min(kMarkEvery, count_ - begin)));
  read_(begin, int64_t(times.size()), times.data());
  return begin + (std::lower_bound(times.begin(), times.end(), time) - times.begin());
}

std::vector<double> TimeSurvey::times(const Stretch& positions) const {
  std::vector<double> out(size_t(positions.size()));
  read_(positions.begin, positions.size(), out.data());
  return out;
}

Stretch TimeSurvey::between(double begin, double end) const {
  const int64_t from = first_at_or_after(begin);
  return {from, std::max(from, first_at_or_after(end))};
}

}  // namespace jade::events
