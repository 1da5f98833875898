// SPDX-License-Identifier: Apache-2.0
// The update of one number of a row, and of one of the twists.
#pragma once

#include "jade/kernel/host_device.h"
#include "jade/train/pose_update.h"

namespace jade::train {

constexpr double kFirstDecay = 0.9, kSecondDecay = 0.999;

/// Adam constants shared by all numbers of a row, at the row's step number `steps`.
struct RowConstants {
  double lr, second_share;
};

JADE_HD RowConstants row_constants(const RowStep& step, double steps) {
  return {step.lr / (1 - kernel::pow(kFirstDecay, steps)), 1 - kernel::pow(kSecondDecay, steps)};
}

JADE_HD void update_number(const RowStep& step, const RowConstants& row, int64_t i) {
  const double g = step.gradient[i];
  const double first = step.first[i] + (1 - kFirstDecay) * (g - step.first[i]);
  const double second = step.second[i] + (1 - kSecondDecay) * (g * g - step.second[i]);
  step.first[i] = first;
  step.second[i] = second;
  step.value[i] -= first / (kernel::sqrt(second / row.second_share) + step.eps) * row.lr;
  step.gradient[i] = 0;
}

JADE_HD void take_along(const GaugeStep& step, int64_t i) {
  double part = 0;
  for (int64_t way = 0; way < step.ways; ++way) {
    part += step.write[way * step.size + i] * step.along[way];
  }
  step.twists[i] -= part;
}

}  // namespace jade::train
