// SPDX-License-Identifier: Apache-2.0
// Events at random places and times, reference sums, and a measure of difference.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <torch/types.h>
#include <vector>

#include "jade/events/event_stream.h"

namespace jade::test {

inline constexpr events::ImageSize kSize{13, 17};

struct Lists {
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  events::EventStream stream() const { return events::EventStream::from_lists(x, y, t, p); }
};

/// Sub-pixel events on the image and up to `margin` px around it.
inline Lists random_events(int64_t count, float margin, int64_t t_end, unsigned seed,
                           const events::ImageSize& size = kSize) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> u(-margin, float(size.width - 1) + margin);
  std::uniform_real_distribution<float> v(-margin, float(size.height - 1) + margin);
  std::uniform_int_distribution<int64_t> time(0, t_end - 1);
  Lists out;
  for (int64_t i = 0; i < count; ++i) {
    out.x.push_back(u(random));
    out.y.push_back(v(random));
    out.t.push_back(time(random));
    out.p.push_back(random() % 3 == 0 ? int8_t(-1) : int8_t(1));
  }
  std::sort(out.t.begin(), out.t.end());
  return out;
}

/// Reference sums, event by event in double.
inline torch::Tensor slow_bins(const Lists& events, int64_t begin, int64_t end, int64_t bins) {
  auto out = torch::zeros({bins, kSize.height, kSize.width}, torch::kFloat64);
  auto a = out.accessor<double, 3>();
  for (size_t i = 0; i < events.x.size(); ++i) {
    if (events.t[i] < begin || events.t[i] >= end) continue;
    const int64_t bin = (events.t[i] - begin) * bins / (end - begin);
    for (int64_t r = 0; r < kSize.height; ++r) {
      for (int64_t c = 0; c < kSize.width; ++c) {
        const double weight = std::max(0.0, 1 - std::abs(double(events.x[i]) - double(c))) *
                              std::max(0.0, 1 - std::abs(double(events.y[i]) - double(r)));
        a[bin][r][c] += weight * events.p[i];
      }
    }
  }
  return out;
}

inline double worst(const torch::Tensor& a, const torch::Tensor& b) {
  return (a.to(torch::kFloat64) - b.to(torch::kFloat64)).abs().max().item<double>();
}

}  // namespace jade::test
