// SPDX-License-Identifier: Apache-2.0
// One Adam step over plain pointers; adam_math.h has its arithmetic. Private to this folder.
#pragma once

#include <cstdint>

namespace jade::gaussians {

/// Adam's decay rates (Kingma and Ba, ICLR 2015), and ε against division by zero, 1e-15 as in 3DGS.
constexpr double kAdamBeta1 = 0.9, kAdamBeta2 = 0.999, kAdamEps = 1e-15;

/// One parameter tensor, rows × row floats. The first `head` floats of a row have step size
/// `head_lr`, the others `tail_lr`.
struct AdamGroup {
  float* value = nullptr;
  float* first = nullptr;
  float* second = nullptr;
  const float* gradient = nullptr;
  int64_t count = 0;  ///< total number of floats
  int64_t row = 1;
  int64_t head = 1;
  double head_lr = 0;
  double tail_lr = 0;
  bool scheduled = false;  ///< step sizes are multiplied by the schedule
  /// Floats 3i, 3i + 1 and 3i + 2 step by the mean of their gradients, so that equal values stay
  /// bit-equal. `row` and `head` must then be multiples of 3.
  bool tied = false;
};

/// Decreases log-linearly over max_steps, then stays constant; log_start and log_end are logarithms
/// of step sizes.
struct AdamSchedule {
  double log_start = 0, log_end = 0;
  double max_steps = 1;
};

constexpr int kMaxAdamGroups = 5;

struct AdamStep {
  AdamGroup groups[kMaxAdamGroups];
  int group_count = 0;
  double beta1 = kAdamBeta1, beta2 = kAdamBeta2, eps = kAdamEps;
  AdamSchedule schedule;
  /// Number of completed steps, which the step increments; on the groups' device.
  int64_t* step = nullptr;
  double* rates = nullptr;  ///< [3] scratch memory there; on a GPU only
};

namespace cpu {
void adam_step(const AdamStep& step);
}

namespace cuda {
/// Runs on the current stream of the current device.
void adam_step(const AdamStep& step);
}  // namespace cuda

}  // namespace jade::gaussians
