// SPDX-License-Identifier: Apache-2.0
#include "jade/import/hot_pixels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::import {
namespace {

constexpr double kTimesMedian = 8;
constexpr double kDeviations = 8;
constexpr int64_t kReach = 2;  // of the neighbourhood, pixels to each side
/// Fewer neighbours with events may be hot too, as in a block of four. Scaling to twice the pixels
/// leaves 8 of 24.
constexpr int64_t kFewestActive = 4;

/// Index of the pixel of each event in an image of this size, or -1.
class PixelOf {
 public:
  PixelOf(const events::EventStream& events, int64_t height, int64_t width)
      : x_(events.x().const_data_ptr<float>()),
        y_(events.y().const_data_ptr<float>()),
        height_(height),
        width_(width) {}
  int64_t operator()(int64_t i) const {
    const float column = std::floor(x_[i] + 0.5f), row = std::floor(y_[i] + 0.5f);
    const bool inside = column >= 0 && column < float(width_) && row >= 0 && row < float(height_);
    return inside ? int64_t(row) * width_ + int64_t(column) : -1;
  }

 private:
  const float *x_, *y_;
  int64_t height_, width_;
};

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

PixelCounter::PixelCounter(const events::ImageSize& size) {
  JADE_CHECK(size.height > 0 && size.width > 0, "expected a sensor of 1 pixel or more");
  counts_ = torch::zeros({size.height, size.width}, torch::kInt64);
}

void PixelCounter::add(const events::EventStream& events) {
  if (events.empty()) return;
  const PixelOf pixel(events, counts_.size(0), counts_.size(1));
  int64_t* const counts = counts_.mutable_data_ptr<int64_t>();
  for (int64_t i = 0; i < events.size(); ++i) {
    const int64_t at = pixel(i);
    if (at >= 0) ++counts[at];
  }
  first_us_ = std::min(first_us_, events.first_us());
  last_us_ = std::max(last_us_, events.last_us());
}

double PixelCounter::seconds() const {
  return last_us_ > first_us_ ? 1e-6 * double(last_us_ - first_us_) : 0;
}

HotPixels find_hot_pixels(const PixelCounter& counter) {
  const torch::Tensor counts = counter.counts();
  const int64_t height = counts.size(0), width = counts.size(1);
  const int64_t* const data = counts.const_data_ptr<int64_t>();
  std::vector<int64_t> all(data, data + counts.numel());
  const double median = median_of_active(all.begin(), all.end(), 1);
  const double seconds = std::max(counter.seconds(), 1e-6);
  HotPixels result{{}, torch::zeros({height, width}, torch::kBool)};
  bool* const mask = result.mask.data_ptr<bool>();
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
      mask[row * width + column] = true;
      result.pixels.push_back({row, column, count / seconds, around / seconds});
    }
  }
  std::stable_sort(result.pixels.begin(), result.pixels.end(),
                   [](const HotPixel& a, const HotPixel& b) { return a.rate_hz > b.rate_hz; });
  return result;
}

events::EventStream remove_events(const events::EventStream& events, const torch::Tensor& mask) {
  check_shape(mask, "mask of pixels", {-1, -1});
  check_dtype(mask, "mask of pixels", torch::kBool);
  const torch::Tensor whole = mask.contiguous();
  const PixelOf pixel(events, whole.size(0), whole.size(1));
  const bool* const hot = whole.const_data_ptr<bool>();
  const torch::Tensor keep = torch::empty({events.size()}, torch::kBool);
  bool* const kept = keep.mutable_data_ptr<bool>();
  for (int64_t i = 0; i < events.size(); ++i) {
    const int64_t at = pixel(i);
    kept[i] = at < 0 || !hot[at];
  }
  const torch::Tensor index = keep.nonzero().flatten();
  const auto some = [&](const torch::Tensor& all) { return all.index_select(0, index); };
  return {some(events.x()), some(events.y()), some(events.t_us()), some(events.polarity())};
}

}  // namespace jade::import
