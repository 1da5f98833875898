// SPDX-License-Identifier: Apache-2.0
#include "jade/events/exposure_maps.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <torch/types.h>
#include <utility>
#include <vector>

#include "jade/core/check.h"
#include "jade/events/counts.h"
#include "jade/events/event_bands.h"

namespace jade::events {
namespace {

std::vector<int64_t> equal_knots(const TimeWindow& window, int64_t parts) {
  std::vector<int64_t> out;
  for (int64_t k = 0; k <= parts; ++k) out.push_back(knot_us(window, k, parts));
  return out;
}

/// Bytes of the sums that a band's events update at one time: they should fit a core's cache.
constexpr int64_t kBandBytes = 1 << 20;
/// Bytes per pixel of the sums: two signs, and density.
constexpr int64_t kPixelBytes = 32;

/// Knots of the three divisions of an exposure.
struct Divisions {
  std::vector<int64_t> bins, windows, signed_windows;
};

/// Sums of a band's events by sign in spans of time, exact as count_events.
struct BandSums {
  std::vector<int64_t> positive, negative;  ///< one per pixel of the band

  /// Calls take(span) with the sums after each span between knots.
  template <class Take>
  void sweep(const EventBands& bands, int64_t band, const std::vector<int64_t>& knots,
             const ImageSize& size, const Take& take) {
    const auto width = static_cast<int32_t>(size.width);
    const int64_t first = bands.first_row(band) * width, pixels = bands.rows(band) * width;
    const BandEvent *event = bands.begin(band), *const last = bands.end(band);
    while (event != last && event->t_us() < knots.front()) ++event;
    for (size_t span = 0; span + 1 < knots.size(); ++span) {
      positive.assign(static_cast<size_t>(pixels), 0);
      negative.assign(static_cast<size_t>(pixels), 0);
      for (; event != last && event->t_us() < knots[span + 1]; ++event) {
        int64_t* const sums = event->positive() ? positive.data() : negative.data();
        spread(event->footprint(), width, static_cast<int32_t>(size.height),
               [&](int64_t pixel, int64_t weight) {
                 if (pixel >= first && pixel < first + pixels) sums[pixel - first] += weight;
               });
      }
      take(static_cast<int64_t>(span));
    }
  }
};

float events_of(int64_t count) {
  return static_cast<float>(static_cast<double>(count) * kCountUnit);
}

/// The sums of all divisions, band by band.
ExposureMaps sums_of(const EventStream& events, const Divisions& knots, const ImageSize& size) {
  const int64_t row_bytes = kPixelBytes * std::max<int64_t>(1, size.width);
  const EventBands bands(events, size, kBandBytes / row_bytes);
  const auto maps = [&](const std::vector<int64_t>& of) {
    return torch::empty({int64_t(of.size()) - 1, size.height, size.width}, torch::kFloat32);
  };
  const torch::Tensor bins = maps(knots.bins);
  ExposureMaps out;
  out.windows = {maps(knots.windows), maps(knots.windows)};
  out.density = torch::empty({size.height, size.width}, torch::kFloat32);
  if (!knots.signed_windows.empty()) out.signed_windows = maps(knots.signed_windows);
  at::parallel_for(0, bands.count(), 1, [&](int64_t begin, int64_t end) {
    BandSums sums;
    std::vector<int64_t> either;
    for (int64_t band = begin; band < end; ++band) {
      const int64_t first = bands.first_row(band) * size.width;
      const auto pixels = static_cast<size_t>(bands.rows(band) * size.width);
      const auto rows_of = [&](const torch::Tensor& all, int64_t map) {
        return all.mutable_data_ptr<float>() + map * size.height * size.width + first;
      };
      either.assign(pixels, 0);
      sums.sweep(bands, band, knots.bins, size, [&](int64_t span) {
        float* const signed_sums = rows_of(bins, span);
        for (size_t i = 0; i < pixels; ++i) {
          signed_sums[i] = events_of(sums.positive[i] - sums.negative[i]);
          either[i] += sums.positive[i] + sums.negative[i];
        }
      });
      std::transform(either.begin(), either.end(), rows_of(out.density, 0), events_of);
      sums.sweep(bands, band, knots.windows, size, [&](int64_t span) {
        const auto& [positive, negative] = out.windows;
        std::transform(sums.positive.begin(), sums.positive.end(), rows_of(positive, span),
                       events_of);
        std::transform(sums.negative.begin(), sums.negative.end(), rows_of(negative, span),
                       events_of);
      });
      if (knots.signed_windows.empty()) continue;
      sums.sweep(bands, band, knots.signed_windows, size, [&](int64_t span) {
        float* const signed_sums = rows_of(out.signed_windows, span);
        for (size_t i = 0; i < pixels; ++i) {
          signed_sums[i] = events_of(sums.positive[i]) - events_of(sums.negative[i]);
        }
      });
    }
  });
  out.voxel = normalized(bins);
  return out;
}

}  // namespace

torch::Tensor edi_windows(WindowCounts&& counts, const Thresholds& thresholds) {
  JADE_CHECK(thresholds.positive > 0 && thresholds.negative > 0,
             "expected thresholds above 0, found ", thresholds.positive, " and ",
             thresholds.negative);
  const auto [positive, negative] = std::exchange(counts, {});
  return positive.mul_(thresholds.positive).sub_(negative.mul_(thresholds.negative));
}

ExposureMaps map_exposure(const EventStream& events, const TimeWindow& exposure, int64_t bins,
                          const ImageSize& size, int64_t parts, int64_t signed_parts) {
  JADE_CHECK(events.device().is_cpu(), "map_exposure: expected events on the CPU");
  JADE_CHECK(bins > 0 && parts > 0 && signed_parts >= 0,
             "expected one bin and one window or more, found ", bins, ", ", parts, " and ",
             signed_parts);
  Divisions knots{equal_knots(exposure, bins), equal_knots(exposure, parts), {}};
  if (signed_parts > 0) knots.signed_windows = equal_knots(exposure, signed_parts);
  return sums_of(events.slice(exposure), knots, size);
}

}  // namespace jade::events
