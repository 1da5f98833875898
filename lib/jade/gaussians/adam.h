// SPDX-License-Identifier: Apache-2.0
// One Adam step over plain pointers; its arithmetic is in adam_math.h. Not for use outside this
// room.
#pragma once

#include <cstdint>

namespace jade::gaussians {

/// Adam's decays of its moments (Kingma and Ba, ICLR 2015), and its guard against division by zero,
/// 1e-15 as in 3DGS.
constexpr double kAdamBeta1 = 0.9, kAdamBeta2 = 0.999, kAdamEps = 1e-15;

/// One parameter tensor, rows × row floats. The first `head` floats of a row have step size
/// `head_lr`, the others `tail_lr`.
struct AdamGroup {
  float* value = nullptr;
  float* first = nullptr;
  float* second = nullptr;
  const float* gradient = nullptr;
  int64_t count = 0;  ///< floats in all
  int64_t row = 1;
  int64_t head = 1;
  double head_lr = 0;
  double tail_lr = 0;
  bool scheduled = false;  ///< step sizes are multiplied by the schedule
  /// Floats 3i, 3i + 1 and 3i + 2 step by the mean of their gradients, so that equal ones stay
  /// equal to the bit. `row` and `head` are multiples of 3 then.
  bool tied = false;
};

/// Falls log-linearly over max_steps and stays; log_start and log_end are of the step sizes.
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
  /// Steps done, to which this one is added; lives where the groups live.
  int64_t* step = nullptr;
  double* rates = nullptr;  ///< [3] of working memory there; on a GPU only
};

namespace cpu {
void adam_step(const AdamStep& step);
}

namespace cuda {
/// On the current stream of the current device.
void adam_step(const AdamStep& step);
}  // namespace cuda

}  // namespace jade::gaussians
