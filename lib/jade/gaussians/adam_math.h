// SPDX-License-Identifier: Apache-2.0
// The arithmetic of one Adam step and its schedule.
#pragma once

#include "jade/gaussians/adam.h"
#include "jade/kernel/host_device.h"

namespace jade::gaussians {

/// Step size at step s: exp(log_start + (log_end − log_start) · min(s / max_steps, 1)).
JADE_HD double scheduled(const AdamSchedule& schedule, double step) {
  const double s = kernel::min(step / schedule.max_steps, 1.0);
  return kernel::exp(schedule.log_start + (schedule.log_end - schedule.log_start) * s);
}

/// Factor of step sizes after the step is counted: the bias correction of the first moment and, for
/// groups with a schedule, the schedule.
JADE_HD double rate_factor(const AdamStep& step, bool follows_schedule) {
  const double steps = static_cast<double>(*step.step);
  const double correction1 = 1 - kernel::pow(step.beta1, steps);
  return (follows_schedule ? scheduled(step.schedule, steps) : 1.0) / correction1;
}

/// Bias correction of the square root of the second moment.
JADE_HD float inverse_sqrt_correction2(const AdamStep& step) {
  const double steps = static_cast<double>(*step.step);
  return static_cast<float>(1 / kernel::sqrt(1 - kernel::pow(step.beta2, steps)));
}

/// Whether float i of a group has step size `head_lr`.
JADE_HD bool in_head(const AdamGroup& group, int64_t i) {
  return group.head == group.row || i % group.row < group.head;
}

/// Gradient of each of three tied floats.
JADE_HD float tied_gradient(const float* three) { return (three[0] + three[1] + three[2]) / 3; }

struct AdamConstants {
  float beta1, beta2, one_minus_beta1, one_minus_beta2, eps, inverse_sqrt_correction2;
};

JADE_HD AdamConstants adam_constants(const AdamStep& step, float inverse_sqrt_correction2) {
  return {static_cast<float>(step.beta1),     static_cast<float>(step.beta2),
          static_cast<float>(1 - step.beta1), static_cast<float>(1 - step.beta2),
          static_cast<float>(step.eps),       inverse_sqrt_correction2};
}

/// Updates one float with gradient g. @param lr  including rate_factor()
JADE_HD void adam_update(const AdamConstants& c, float lr, float g, float& value, float& first,
                         float& second) {
  const float m = c.beta1 * first + c.one_minus_beta1 * g;
  const float v = c.beta2 * second + c.one_minus_beta2 * g * g;
  first = m;
  second = v;
  value -= lr * m / (kernel::sqrt(v) * c.inverse_sqrt_correction2 + c.eps);
}

}  // namespace jade::gaussians
