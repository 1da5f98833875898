// SPDX-License-Identifier: Apache-2.0
#include <ATen/Parallel.h>

#include "jade/gaussians/noise_math.h"

namespace jade::gaussians::cpu {

void add_noise(const NoiseStep& step) {
  constexpr int64_t kRows = 2048;
  at::parallel_for(0, step.count, kRows, [&](int64_t begin, int64_t end) {
    for (int64_t row = begin; row < end; ++row) add_noise_to(step, row);
  });
}

}  // namespace jade::gaussians::cpu
