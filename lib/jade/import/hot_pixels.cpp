// SPDX-License-Identifier: Apache-2.0
#include "jade/import/hot_pixels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <torch/types.h>

#include "jade/events/pixels.h"

namespace jade::import {
namespace {

constexpr double kTimesMedian = 8;
constexpr double kDeviations = 8;
constexpr int64_t kReach = 2;  // of the neighbourhood, pixels to each side
/// Fewer neighbours with events may be hot too, as in a block of four. Scaling to twice the pixels
/// leaves 8 of 24.
constexpr int64_t kFewestActive = 4;

/// Median of the counts that are not 0; 0 if fewer than `fewest` are.
template <class Counts>
double median_of_active(Counts first, Counts last, int64_t fewest) {
  last = std::remove(first, last, int64_t(0));
  if (last - first < fewest) return 0;
  const auto middle = first + (last - first) / 2;
  std::nth_element(first, middle, last);
  return double(*middle);
}

/// Median of the neighbours of a pixel that have events, excluding itself.
double median_around(const int64_t* counts, int64_t row, int64_t column, int64_t height,
                     int64_t width) {
  std::array<int64_t, (2 * kReach + 1) * (2 * kReach + 1)> values{};
  size_t n = 0;
  for (int64_t i = std::max<int64_t>(0, row - kReach); i <= std::min(height - 1, row + kReach);
       ++i) {
    for (int64_t j = std::max<int64_t>(0, column - kReach);
         j <= std::min(width - 1, column + kReach); ++j) {
      if (i != row || j != column) values[n++] = counts[i * width + j];
    }
  }
  return median_of_active(values.begin(), values.begin() + std::ptrdiff_t(n), kFewestActive);
}

}  // namespace

std::vector<HotPixel> find_hot_pixels(const events::EventStream& events,
                                      const events::ImageSize& sensor) {
  if (events.empty()) return {};
  const torch::Tensor counts = events::pixel_counts(events, sensor);
  const auto [height, width] = sensor;
  const int64_t* const data = counts.const_data_ptr<int64_t>();
  std::vector<int64_t> all(data, data + counts.numel());
  const double median = median_of_active(all.begin(), all.end(), 1);
  const double seconds = 1e-6 * std::max(double(events.last_us() - events.first_us()), 1.0);
  std::vector<HotPixel> pixels;
  for (int64_t row = 0; row < height; ++row) {
    for (int64_t column = 0; column < width; ++column) {
      const auto count = double(data[row * width + column]);
      const auto is_above = [&](double usual) {
        return count > kTimesMedian * usual &&
               count > usual + kDeviations * std::sqrt(std::max(usual, 1.0));
      };
      if (!is_above(median)) continue;
      const double around = median_around(data, row, column, height, width);
      if (!is_above(around)) continue;
      pixels.push_back({row, column, count / seconds, around / seconds});
    }
  }
  std::stable_sort(pixels.begin(), pixels.end(),
                   [](const HotPixel& a, const HotPixel& b) { return a.rate_hz > b.rate_hz; });
  return pixels;
}

}  // namespace jade::import
