// SPDX-License-Identifier: Apache-2.0
#include "jade/events/ramps.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <torch/types.h>
#include <vector>

#include "jade/core/check.h"
#include "jade/events/count_math.h"
#include "jade/events/counts.h"

namespace jade::events {
namespace {

/// Calls add(window, share) for the windows between `knots` that the span (begin, end] of one
/// event's step reaches; shares add up to 1 over all time. An empty span is a step at `end`.
template <class Add>
void share_out(const std::vector<int64_t>& knots, int64_t begin, int64_t end, const Add& add) {
  const auto last = static_cast<int64_t>(knots.size()) - 2;
  const auto window_of = [&](int64_t t) {
    return std::upper_bound(knots.begin(), knots.end(), t) - knots.begin() - 1;
  };
  if (begin >= end) {
    const int64_t j = window_of(end);
    if (j >= 0 && j <= last) add(j, 1.0f);
    return;
  }
  for (int64_t j = std::max<int64_t>(0, window_of(begin)); j <= last && knots[j] < end; ++j) {
    const int64_t inside = std::min(end, knots[j + 1]) - std::max(begin, knots[j]);
    if (inside > 0) add(j, static_cast<float>(inside) / static_cast<float>(end - begin));
  }
}

/// Bytes of one band's sums: they should stay in a core's cache.
constexpr int64_t kBandBytes = 1 << 20;

/// Events by bands of image rows, in order of time, with the begin of each event's ramp.
struct RampedEvents {
  int64_t band_rows = 1;
  std::vector<int64_t> begin_us;              ///< per event
  std::vector<std::vector<int64_t>> in_band;  ///< indices of the events that touch a band's rows
};

/// One pass in order of time: a ramp begins at the previous event of the nearest pixel.
RampedEvents sort_into_bands(const EventStream& events, int64_t first_us, int64_t reach_us,
                             const ImageSize& size, int64_t band_rows) {
  const float* const x = events.x().const_data_ptr<float>();
  const float* const y = events.y().const_data_ptr<float>();
  const int64_t* const t = events.t_us().const_data_ptr<int64_t>();
  const auto width = static_cast<int32_t>(size.width), height = static_cast<int32_t>(size.height);
  RampedEvents out;
  out.band_rows = band_rows;
  out.begin_us.resize(static_cast<size_t>(events.size()));
  out.in_band.resize(static_cast<size_t>((size.height + band_rows - 1) / band_rows));
  std::vector<int64_t> before(static_cast<size_t>(size.height * size.width), first_us);
  for (int64_t i = 0; i < events.size(); ++i) {
    EventFootprint footprint;
    if (!locate(x[i], y[i], width, height, footprint)) continue;
    const int32_t column =
        std::clamp(footprint.column + int32_t(footprint.fx >= kWhole / 2), 0, width - 1);
    const int32_t row =
        std::clamp(footprint.row + int32_t(footprint.fy >= kWhole / 2), 0, height - 1);
    int64_t& previous = before[static_cast<size_t>(row) * size.width + column];
    out.begin_us[static_cast<size_t>(i)] = std::max(previous, t[i] - reach_us);
    previous = t[i];
    const int64_t top = std::max(footprint.row, 0) / band_rows;
    const int64_t bottom =
        std::min(footprint.row + int32_t(footprint.fy > 0), height - 1) / band_rows;
    for (int64_t band = top; band <= bottom; ++band) {
      out.in_band[static_cast<size_t>(band)].push_back(i);
    }
  }
  return out;
}

/// Sums of the events in a band of rows, [2, pixels of the band, windows] with the windows of one
/// pixel side by side, as an event touches many of them.
void sum_band(const EventStream& events, const RampedEvents& ramps, size_t band,
              const std::vector<int64_t>& knots, const ImageSize& size, int64_t first_pixel,
              int64_t pixels, float* sums) {
  const float* const x = events.x().const_data_ptr<float>();
  const float* const y = events.y().const_data_ptr<float>();
  const int64_t* const t = events.t_us().const_data_ptr<int64_t>();
  const int8_t* const polarity = events.polarity().const_data_ptr<int8_t>();
  const auto width = static_cast<int32_t>(size.width), height = static_cast<int32_t>(size.height);
  const auto windows = static_cast<int64_t>(knots.size()) - 1;
  for (const int64_t i : ramps.in_band[band]) {
    EventFootprint footprint;
    locate(x[i], y[i], width, height, footprint);
    float* const plane = sums + (polarity[i] > 0 ? 0 : pixels * windows);
    share_out(
        knots, ramps.begin_us[static_cast<size_t>(i)], t[i], [&](int64_t window, float share) {
          spread(footprint, width, height, [&](int64_t pixel, int64_t weight) {
            const int64_t inside = pixel - first_pixel;
            if (inside < 0 || inside >= pixels) return;
            plane[inside * windows + window] += share * static_cast<float>(weight * kCountUnit);
          });
        });
  }
}

}  // namespace

WindowCounts ramped_windows(const EventStream& events, const TimeWindow& exposure, int64_t parts,
                            int64_t reach_us, const ImageSize& size) {
  JADE_CHECK(parts > 0 && reach_us >= 0,
             "expected one window or more and a reach of 0 or more, found ", parts, " and ",
             reach_us, " us");
  std::vector<int64_t> knots;
  for (int64_t k = 0; k <= parts; ++k) knots.push_back(knot_us(exposure, k, parts));
  const int64_t windows = parts;
  const EventStream near = events.slice(knots.front() - reach_us, knots.back() + reach_us);
  const int64_t row_bytes = 2 * size.width * windows * int64_t(sizeof(float));
  const int64_t band_rows = std::clamp<int64_t>(kBandBytes / row_bytes, 1, size.height);
  const RampedEvents ramps =
      sort_into_bands(near, knots.front() - 2 * reach_us, reach_us, size, band_rows);
  const torch::Tensor maps = torch::empty({2, windows, size.height, size.width}, torch::kFloat32);
  auto* const out = maps.mutable_data_ptr<float>();
  const int64_t all_pixels = size.height * size.width;
  // Every pixel belongs to one band and adds up its events in order of time: the same bits for any
  // number of threads.
  at::parallel_for(0, int64_t(ramps.in_band.size()), 1, [&](int64_t begin, int64_t end) {
    std::vector<float> sums;
    for (int64_t band = begin; band < end; ++band) {
      const int64_t first_row = band * band_rows;
      const int64_t rows = std::min(band_rows, size.height - first_row);
      const int64_t first_pixel = first_row * size.width, pixels = rows * size.width;
      sums.assign(static_cast<size_t>(2 * pixels * windows), 0);
      sum_band(near, ramps, static_cast<size_t>(band), knots, size, first_pixel, pixels,
               sums.data());
      for (int64_t plane = 0; plane < 2 * windows; ++plane) {
        const float* const from =
            sums.data() + plane / windows * pixels * windows + plane % windows;
        float* const to = out + plane * all_pixels + first_pixel;
        for (int64_t pixel = 0; pixel < pixels; ++pixel) to[pixel] = from[pixel * windows];
      }
    }
  });
  return {maps[0], maps[1]};
}

}  // namespace jade::events
