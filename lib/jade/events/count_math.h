// SPDX-License-Identifier: Apache-2.0
// Pixel of an event and its bilinear weights. Must not include torch.
#pragma once

#include <cstdint>

#include "jade/kernel/host_device.h"

namespace jade::events {

// Coordinates are rounded to 2⁻¹⁵ px (float's own step from column 256 on), so that the four
// bilinear weights are integer multiples of 2⁻³⁰ and add up to exactly 1. Integer sums do not
// depend on their order: any number of threads, any device and any order of simultaneous events
// give the same bits. 64 bits hold 8·10⁹ events on one pixel.
constexpr int kFractionBits = 15;
constexpr int32_t kWhole = 1 << kFractionBits;
constexpr double kCountUnit = 1.0 / (double(kWhole) * double(kWhole));

struct EventFootprint {
  int32_t column, row;  ///< upper left pixel; may be -1
  int32_t fx, fy;       ///< distance from it, in units of 2⁻¹⁵ px
};

/// Returns false, without setting `place`, for NaN and for events one pixel or more from every
/// pixel centre.
JADE_HD bool locate(float x, float y, int32_t width, int32_t height, EventFootprint& out) {
  if (!(x > -1.0f && x < float(width) && y > -1.0f && y < float(height))) return false;
  // The product is exact, so a fused multiply-add rounds identically.
  const int32_t qx = int32_t(kernel::floor(x * float(kWhole) + 0.5f));
  const int32_t qy = int32_t(kernel::floor(y * float(kWhole) + 0.5f));
  out.column = qx >> kFractionBits;
  out.row = qy >> kFractionBits;
  out.fx = qx & (kWhole - 1);
  out.fy = qy & (kWhole - 1);
  return true;
}

/// Calls add(pixel index, weight) for the pixels inside the image with a non-zero weight.
template <class Add>
JADE_HD void spread(const EventFootprint& f, int32_t width, int32_t height, const Add& add) {
  const int64_t base = int64_t(f.row) * width + f.column;
  const bool left = f.column >= 0 && f.column<width, right = f.fx> 0 && f.column + 1 < width;
  if (f.row >= 0 && f.row < height) {
    const int64_t weight = kWhole - f.fy;
    if (left) add(base, weight * (kWhole - f.fx));
    if (right) add(base + 1, weight * f.fx);
  }
  if (f.fy > 0 && f.row + 1 < height) {
    const int64_t weight = f.fy;
    if (left) add(base + width, weight * (kWhole - f.fx));
    if (right) add(base + width + 1, weight * f.fx);
  }
}

}  // namespace jade::events
