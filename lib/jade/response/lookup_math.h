// SPDX-License-Identifier: Apache-2.0
// Lookup of one number in the table, and its gradient. Must not include torch.
#pragma once

#include <cstdint>

#include "jade/kernel/host_device.h"

namespace jade::response {

/// The table's knots are linspace(0, 2, 4097); the outermost cells extrapolate.
constexpr int64_t kKnots = 4097;
constexpr double kResponseRange = 2;

template <class T>
constexpr T kCellsPerUnit = static_cast<T>((kKnots - 1) / kResponseRange);

/// Between knots `index` and `index` + 1.
template <class T>
struct Cell {
  int32_t index;
  T fraction;  ///< in [0,1] inside the table, beyond it outside
};

template <class T>
JADE_HD Cell<T> cell_of(T x) {
  const T t = x * kCellsPerUnit<T>;
  // Written so that NaN maps to the first cell.
  const T bounded = t > 0 ? kernel::min(t, static_cast<T>(kKnots - 2)) : T(0);
  const auto index = static_cast<int32_t>(bounded);
  return {index, t - static_cast<T>(index)};
}

/// ρ from the values at the cell's knots.
template <class T>
JADE_HD T interpolate(const Cell<T>& cell, T lower, T upper) {
  return lower + cell.fraction * (upper - lower);
}

/// The gradient of x, from that of ρ(x).
template <class T>
JADE_HD T gradient_of_x(T gradient, T lower, T upper) {
  return gradient * (upper - lower) * kCellsPerUnit<T>;
}

/// The gradient of the upper knot, from that of ρ(x); the lower one gets the rest.
template <class T>
JADE_HD T gradient_of_upper(const Cell<T>& cell, T gradient) {
  return gradient * cell.fraction;
}

}  // namespace jade::response
