// SPDX-License-Identifier: Apache-2.0
#include "jade/train/pose_update_math.h"

namespace jade::train::cpu {

void accumulate(const RowGradient& step) {
  for (int64_t i = 0; i < step.size; ++i) step.gradient[i] += step.of[i];
  ++step.seen[*step.row];
}

void update_rows(const RowStep& step) {
  for (int64_t row = 0; row < step.rows; ++row) {
    if (step.seen[row] <= 0) continue;
    step.steps[row] += 1;
    step.seen[row] = 0;
    const RowConstants constants = row_constants(step, step.steps[row]);
    for (int64_t i = row * step.row; i < (row + 1) * step.row; ++i) {
      update_number(step, constants, i);
    }
  }
}

void remove_gauge(const GaugeStep& step) {
  for (int64_t way = 0; way < step.ways; ++way) {
    double along = 0;
    for (int64_t i = 0; i < step.size; ++i)
      along += step.read[way * step.size + i] * step.twists[i];
    step.along[way] = along;
  }
  for (int64_t i = 0; i < step.size; ++i) take_along(step, i);
}

}  // namespace jade::train::cpu
