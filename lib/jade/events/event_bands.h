// SPDX-License-Identifier: Apache-2.0
// Events sorted into bands of image rows, whose sums fit a core's cache. Private to this folder.
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/events/count_math.h"
#include "jade/events/event_stream.h"

namespace jade::events {

/// One event in 16 bytes, rounded as in locate().
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

/// A band contains, in the order of the stream, all events whose nearest pixel lies in its rows or
/// one row beside them, and thus all events with a weight in it. Threads only divide the work.
class EventBands {
 public:
  /// @param events  on the CPU
  /// @param rows    upper bound of rows per band, rounded down to a power of two (at least 1)
  /// @throws ContractError as check_image_size.
  EventBands(const EventStream& events, const ImageSize& size, int64_t rows);

  int64_t count() const { return int64_t(starts_.size()) - 1; }
  int64_t first_row(int64_t band) const { return band << row_bits_; }
  /// Number of rows in the band; the last band may have fewer.
  int64_t rows(int64_t band) const;
  const BandEvent* begin(int64_t band) const { return data_ + starts_[size_t(band)]; }
  const BandEvent* end(int64_t band) const { return data_ + starts_[size_t(band) + 1]; }

 private:
  int64_t height_;
  int row_bits_ = 0;
  torch::Tensor events_;  ///< [N,2] int64, the bytes of N BandEvent
  const BandEvent* data_ = nullptr;
  std::vector<int64_t> starts_;  ///< start of each band, and the end of the last
};

}  // namespace jade::events
