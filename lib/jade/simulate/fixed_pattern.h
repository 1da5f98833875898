// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "jade/simulate/options.h"

namespace jade::simulate {

/// One flag per column, `count` of them set at random by the seed (all, if there are no more).
std::vector<uint8_t> drawn_columns(int64_t count, int64_t width, uint64_t seed);

/// Fixed pattern of a frame sensor: offsets of rows, columns and pixels, and dead columns.
class FixedPattern {
 public:
  FixedPattern(const ImageSensorOptions& options, int64_t width, int64_t height, uint64_t seed);
  bool is_empty() const { return offset_.empty() && dead_.empty(); }
  /// Sensor value for light of `value`, a fraction of white.
  /// @param pixel  row-major index
  double apply(double value, size_t pixel) const;

 private:
  size_t width_;
  std::vector<float> offset_;  // [H*W], or empty
  std::vector<uint8_t> dead_;  // per column, or empty
};

}  // namespace jade::simulate
