// SPDX-License-Identifier: Apache-2.0
#include "jade/events/ramps.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <torch/types.h>
#include <utility>
#include <vector>

#include "jade/core/check.h"
#include "jade/events/count_math.h"
#include "jade/events/counts.h"
#include "jade/events/event_bands.h"

namespace jade::events {
namespace {

/// Bytes of the sums that a band's events update at one time: they should fit a core's cache.
constexpr int64_t kBandBytes = 1 << 20;
/// Bytes per pixel of the sums: two signs of about six windows, the reach of a ramp, and a time.
constexpr int64_t kPixelBytes = 56;

/// Calls add(window, share) for the windows between `knots` that overlap the span (begin, end] of
/// one event's step; the shares over all time add up to 1. An empty span is a step at `end`.
/// @param now  the last knot at or before `end`, -1 for none
template <class Add>
void share_out(const std::vector<int64_t>& knots, int64_t now, int64_t begin, int64_t end,
               const Add& add) {
  const auto last = static_cast<int64_t>(knots.size()) - 2;
  if (begin >= end) {
    if (now >= 0 && now <= last) add(now, 1.0f);
    return;
  }
  int64_t j = now;
  while (j >= 0 && knots[j] > begin) --j;
  for (j = std::max<int64_t>(0, j); j <= last && knots[j] < end; ++j) {
    const int64_t inside = std::min(end, knots[j + 1]) - std::max(begin, knots[j]);
    if (inside > 0) add(j, static_cast<float>(inside) / static_cast<float>(end - begin));
  }
}

/// Weight of an event at a pixel, as a float number of events.
struct PixelWeight {
  int64_t pixel;
  float weight;
};

/// The knots of the windows, the reach of a ramp, and the sums.
struct Ramps {
  std::vector<int64_t> knots;
  int64_t reach_us;
  ImageSize size;
  float* out;  ///< [2,J,H,W], not initialised

  int64_t windows() const { return static_cast<int64_t>(knots.size()) - 1; }
  int64_t pixels() const { return size.height * size.width; }
};

/// Sums the rows of one band. Each pixel adds its events in order of time.
/// @param before  scratch memory
void sum_band(const EventBands& bands, int64_t band, const Ramps& ramps,
              std::vector<int64_t>& before) {
  const auto width = static_cast<int32_t>(ramps.size.width);
  const auto height = static_cast<int32_t>(ramps.size.height);
  const int64_t windows = ramps.windows(), all_pixels = ramps.pixels();
  const int64_t first_pixel = bands.first_row(band) * width;
  const int64_t pixels = bands.rows(band) * width;
  // Previous event time of the band's pixels and of the rows beside it.
  before.assign(static_cast<size_t>(pixels + 2 * width), ramps.knots.front() - 2 * ramps.reach_us);
  const int64_t first_before = first_pixel - width;
  int64_t now = -1;
  // Zero a window's sums just before its first event, while they enter the cache.
  const auto begin_windows = [&](int64_t t) {
    while (now + 1 < static_cast<int64_t>(ramps.knots.size()) && ramps.knots[now + 1] <= t) {
      if (++now == windows) return;
      for (int64_t plane = now; plane < 2 * windows; plane += windows) {
        std::fill_n(ramps.out + plane * all_pixels + first_pixel, pixels, 0.0f);
      }
    }
  };
  const BandEvent* const last = bands.end(band);
  for (const BandEvent* event = bands.begin(band); event != last; ++event) {
    const EventFootprint footprint = event->footprint();
    const int64_t t = event->t_us();
    begin_windows(t);
    const NearestPixel nearest = nearest_pixel(footprint, width, height);
    const int64_t nearest_index = int64_t(nearest.row) * width + nearest.column;
    int64_t& previous = before[static_cast<size_t>(nearest_index - first_before)];
    const int64_t begin = std::max(previous, t - ramps.reach_us);
    previous = t;
    PixelWeight touched[4];
    int count = 0;
    spread(footprint, width, height, [&](int64_t pixel, int64_t weight) {
      if (pixel < first_pixel || pixel >= first_pixel + pixels) return;
      touched[count++] = {pixel, static_cast<float>(weight * kCountUnit)};
    });
    float* const planes = ramps.out + (event->positive() ? 0 : windows * all_pixels);
    share_out(ramps.knots, now, begin, t, [&](int64_t window, float share) {
      float* const plane = planes + window * all_pixels;
      for (int k = 0; k < count; ++k) plane[touched[k].pixel] += share * touched[k].weight;
    });
  }
  begin_windows(ramps.knots.back());
}

}  // namespace

WindowCounts ramped_windows(const EventStream& events, const TimeWindow& exposure, int64_t parts,
                            int64_t reach_us, const ImageSize& size) {
  JADE_CHECK(parts > 0 && reach_us >= 0,
             "expected one window or more and a reach of 0 or more, found ", parts, " and ",
             reach_us, " us");
  std::vector<int64_t> knots;
  for (int64_t k = 0; k <= parts; ++k) knots.push_back(knot_us(exposure, k, parts));
  const EventStream near = events.slice(knots.front() - reach_us, knots.back() + reach_us);
  const EventBands bands(near, size, kBandBytes / (kPixelBytes * std::max<int64_t>(1, size.width)));
  const torch::Tensor maps = torch::empty({2, parts, size.height, size.width}, torch::kFloat32);
  const Ramps ramps{std::move(knots), reach_us, size, maps.mutable_data_ptr<float>()};
  // Every pixel belongs to one band: any number of threads gives the same bits.
  at::parallel_for(0, bands.count(), 1, [&](int64_t begin, int64_t end) {
    std::vector<int64_t> before;
    for (int64_t band = begin; band < end; ++band) sum_band(bands, band, ramps, before);
  });
  return {maps[0], maps[1]};
}

}  // namespace jade::events
