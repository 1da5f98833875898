// SPDX-License-Identifier: Apache-2.0
#include <ATen/Parallel.h>
#include <algorithm>

#include "jade/gaussians/adam_math.h"

namespace jade::gaussians::cpu {
namespace {

constexpr int64_t kChunkRows = 1024;
constexpr int64_t kWidestRow = 64;

/// Updates `size` floats, float i with step size lr[i].
void update(const AdamConstants& c, const float* __restrict lr, const float* __restrict gradient,
            float* __restrict value, float* __restrict first, float* __restrict second,
            int64_t size) {
  for (int64_t i = 0; i < size; ++i) {
    adam_update(c, lr[i], gradient[i], value[i], first[i], second[i]);
  }
}

/// Replaces each three gradients by their mean; `size` is a multiple of 3.
void tie(const float* gradient, int64_t size, float* tied) {
  for (int64_t i = 0; i < size; i += 3) {
    tied[i] = tied[i + 1] = tied[i + 2] = tied_gradient(gradient + i);
  }
}

/// Fills the step sizes of as many whole rows as fit, with bias correction and schedule.
int64_t fill_rates(const AdamGroup& group, double factor, float* lr) {
  const int64_t rows = std::max<int64_t>(1, kWidestRow / group.row);
  for (int64_t i = 0; i < rows * group.row; ++i) {
    const double rate = in_head(group, i) ? group.head_lr : group.tail_lr;
    lr[i] = static_cast<float>(rate * factor);
  }
  return rows * group.row;
}

void update_group(const AdamGroup& group, const AdamConstants& c, double factor) {
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
  ++*step.step;
  const AdamConstants constants = adam_constants(step, inverse_sqrt_correction2(step));
  for (int i = 0; i < step.group_count; ++i) {
    const AdamGroup& group = step.groups[i];
    update_group(group, constants, rate_factor(step, group.scheduled));
  }
}

}  // namespace jade::gaussians::cpu
