// SPDX-License-Identifier: Apache-2.0
#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>

#include "jade/gaussians/adam.h"

namespace jade::gaussians::cpu {
namespace {

constexpr int64_t kChunkRows = 1024;
constexpr int64_t kWidestRow = 64;

struct Constants {
  float beta1, beta2, one_minus_beta1, one_minus_beta2, eps, inverse_sqrt_correction2;
};

/// `size` floats, of which float i steps by lr[i].
void update(const Constants& c, const float* __restrict lr, const float* __restrict gradient,
            float* __restrict value, float* __restrict first, float* __restrict second,
            int64_t size) {
  for (int64_t i = 0; i < size; ++i) {
    const float g = gradient[i];
    const float m = c.beta1 * first[i] + c.one_minus_beta1 * g;
    const float v = c.beta2 * second[i] + c.one_minus_beta2 * g * g;
    first[i] = m;
    second[i] = v;
    value[i] -= lr[i] * m / (std::sqrt(v) * c.inverse_sqrt_correction2 + c.eps);
  }
}

/// The mean of each three gradients in the place of all three; `size` is a multiple of 3.
void tie(const float* gradient, int64_t size, float* tied) {
  for (int64_t i = 0; i < size; i += 3) {
    const float mean = (gradient[i] + gradient[i + 1] + gradient[i + 2]) / 3;
    tied[i] = tied[i + 1] = tied[i + 2] = mean;
  }
}

/// The step sizes of as many whole rows as fit, bias correction and schedule included.
int64_t fill_rates(const AdamGroup& group, double factor, float* lr) {
  const int64_t rows = std::max<int64_t>(1, kWidestRow / group.row);
  for (int64_t i = 0; i < rows * group.row; ++i) {
    const double rate = i % group.row < group.head ? group.head_lr : group.tail_lr;
    lr[i] = static_cast<float>(rate * factor);
  }
  return rows * group.row;
}

void update_group(const AdamGroup& group, const Constants& c, double factor) {
  float lr[2 * kWidestRow];
  const int64_t block = fill_rates(group, factor, lr);
  const int64_t blocks = (group.count + block - 1) / block;
  at::parallel_for(0, blocks, std::max<int64_t>(1, kChunkRows * 3 / block),
                   [&](int64_t begin, int64_t end) {
                     float tied[2 * kWidestRow];
                     for (int64_t b = begin; b < end; ++b) {
                       const int64_t at = b * block, size = std::min(block, group.count - at);
                       const float* gradient = group.gradient + at;
                       if (group.tied) tie(gradient, size, tied);
                       update(c, lr, group.tied ? tied : gradient, group.value + at,
                              group.first + at, group.second + at, size);
                     }
                   });
}

}  // namespace

void adam_step(const AdamStep& step) {
  const auto steps = static_cast<double>(*step.step);
  const double correction1 = 1 - std::pow(step.beta1, steps);
  const double correction2 = 1 - std::pow(step.beta2, steps);
  const Constants c{
      static_cast<float>(step.beta1),     static_cast<float>(step.beta2),
      static_cast<float>(1 - step.beta1), static_cast<float>(1 - step.beta2),
      static_cast<float>(step.eps),       static_cast<float>(1 / std::sqrt(correction2))};
  const double s = std::min(steps / step.max_steps, 1.0);
  const double schedule = std::exp(step.log_start + (step.log_end - step.log_start) * s);
  for (int i = 0; i < step.group_count; ++i) {
    const double factor = (step.groups[i].scheduled ? schedule : 1) / correction1;
    update_group(step.groups[i], c, factor);
  }
}

}  // namespace jade::gaussians::cpu
