// SPDX-License-Identifier: Apache-2.0
// g(·) of one pixel, also for device code. color.h has g(·) of images.
#pragma once

#include <cstdint>

#include "jade/kernel/host_device.h"

namespace jade::imaging {

/// kGrayWeights, for device code.
constexpr double kLumaRed = 0.299, kLumaGreen = 0.587, kLumaBlue = 0.114;

template <class T>
JADE_HD T luma(T red, T green, T blue) {
  return red * T(kLumaRed) + green * T(kLumaGreen) + blue * T(kLumaBlue);
}

/// Gradient of luma() in channel `c`, from the gradient of its value.
template <class T>
JADE_HD T luma_gradient(int64_t c, T gradient) {
  return gradient * (c == 0 ? T(kLumaRed) : c == 1 ? T(kLumaGreen) : T(kLumaBlue));
}

}  // namespace jade::imaging
