// SPDX-License-Identifier: Apache-2.0
#include "jade/events/event_bands.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <torch/types.h>

namespace jade::events {
namespace {

static_assert(sizeof(BandEvent) == 16, "EventBands keeps two int64 per event");

/// Number of events that are sorted together; chunks are sorted in parallel.
constexpr int64_t kChunk = 1 << 17;
/// Minimum number of bands per image, so that many threads have work.
constexpr int64_t kFewestBands = 32;

/// Calls take(event, first band, last band) for the events begin, …, end − 1 that touch the image.
template <class Take>
void for_each_located(const EventStream& events, const ImageSize& size, int row_bits, int64_t begin,
                      int64_t end, const Take& take) {
  const float* const x = events.x().const_data_ptr<float>();
  const float* const y = events.y().const_data_ptr<float>();
  const int64_t* const t = events.t_us().const_data_ptr<int64_t>();
  const int8_t* const polarity = events.polarity().const_data_ptr<int8_t>();
  const auto width = static_cast<int32_t>(size.width), height = static_cast<int32_t>(size.height);
  for (int64_t i = begin; i < end; ++i) {
    EventFootprint f;
    if (!locate(x[i], y[i], width, height, f)) continue;
    const int32_t row = nearest_pixel(f, width, height).row;
    const BandEvent event{2 * t[i] + int64_t(polarity[i] > 0), int16_t(f.column), int16_t(f.row),
                          uint16_t(f.fx), uint16_t(f.fy)};
    take(event, std::max(row - 1, 0) >> row_bits, std::min(row + 1, height - 1) >> row_bits);
  }
}

}  // namespace

EventBands::EventBands(const EventStream& events, const ImageSize& size, int64_t rows)
    : height_(size.height) {
  check_image_size(size);
  rows = std::min(rows, height_ / kFewestBands);
  while ((int64_t(2) << row_bits_) <= rows) ++row_bits_;
  const int64_t bands = ((height_ - 1) >> row_bits_) + 1;
  const int64_t chunks = (events.size() + kChunk - 1) / kChunk;
  // Per chunk and band: the number of events, then the position of the next one.
  std::vector<int64_t> places(size_t(chunks * bands), 0);
  const auto sort = [&](const auto& take) {
    at::parallel_for(0, chunks, 1, [&](int64_t begin, int64_t end) {
      for (int64_t chunk = begin; chunk < end; ++chunk) {
        int64_t* const of_chunk = places.data() + chunk * bands;
        for_each_located(events, size, row_bits_, chunk * kChunk,
                         std::min((chunk + 1) * kChunk, events.size()),
                         [&](const BandEvent& event, int32_t first, int32_t last) {
                           for (int32_t band = first; band <= last; ++band) {
                             take(event, of_chunk[band]++);
                           }
                         });
      }
    });
  };
  sort([](const BandEvent&, int64_t) {});
  int64_t next = 0;
  for (int64_t band = 0; band < bands; ++band) {
    starts_.push_back(next);
    for (int64_t chunk = 0; chunk < chunks; ++chunk) {
      int64_t& place = places[size_t(chunk * bands + band)];
      const int64_t events_there = place;
      place = next;
      next += events_there;
    }
  }
  starts_.push_back(next);
  events_ = torch::empty({next, 2}, torch::kInt64);
  auto* const out = reinterpret_cast<BandEvent*>(events_.mutable_data_ptr<int64_t>());
  sort([out](const BandEvent& event, int64_t place) { out[place] = event; });
  data_ = out;
}

int64_t EventBands::rows(int64_t band) const {
  return std::min(int64_t(1) << row_bits_, height_ - first_row(band));
}

}  // namespace jade::events
