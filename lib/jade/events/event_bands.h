// SPDX-License-Identifier: Apache-2.0
// Events sorted into bands of image rows, whose sums fit a core's cache. Not for use outside this
// room.
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/events/count_math.h"
#include "jade/events/event_stream.h"

namespace jade::events {

/// One event in 16 bytes, rounded as locate() rounds.
struct BandEvent {
  int64_t t_and_sign;  ///< 2 t_us + 1 for a positive event, else 2 t_us
  int16_t column, row;
  uint16_t fx, fy;

  int64_t t_us() const { return t_and_sign >> 1; }
  bool positive() const { return (t_and_sign & 1) != 0; }
  EventFootprint footprint() const { return {column, row, fx, fy}; }
};

/// Nearest pixel of the image.
struct NearestPixel {
  int32_t column, row;
};
inline NearestPixel nearest_pixel(const EventFootprint& f, int32_t width, int32_t height) {
  const auto inside = [](int32_t value, int32_t size) {
    return value < 0 ? 0 : value >= size ? size - 1 : value;
  };
  return {inside(f.column + int32_t(f.fx >= kWhole / 2), width),
          inside(f.row + int32_t(f.fy >= kWhole / 2), height)};
}

/// A band of rows has all events whose nearest pixel lies in it or one row beside it, and so all
/// that have weight in it, in the order of the stream. Threads only share the work.
class EventBands {
 public:
  /// @param events  on the CPU
  /// @param rows    of a band, at most; the largest power of two within it is taken, 1 or more
  /// @throws ContractError as check_image_size.
  EventBands(const EventStream& events, const ImageSize& size, int64_t rows);

  int64_t count() const { return int64_t(starts_.size()) - 1; }
  int64_t first_row(int64_t band) const { return band << row_bits_; }
  /// Rows of the band; the last one may have fewer than the others.
  int64_t rows(int64_t band) const;
  const BandEvent* begin(int64_t band) const { return data_ + starts_[size_t(band)]; }
  const BandEvent* end(int64_t band) const { return data_ + starts_[size_t(band) + 1]; }

 private:
  int64_t height_;
  int row_bits_ = 0;
  torch::Tensor events_;  ///< [N,2] int64, the bytes of N BandEvent
  const BandEvent* data_ = nullptr;
  std::vector<int64_t> starts_;  ///< where each band begins, and the end
};

}  // namespace jade::events
