// SPDX-License-Identifier: Apache-2.0
// The exploration noise of 3DGS-MCMC over plain pointers; its arithmetic is in noise_math.h. Not
// for use outside this room: mcmc.h has the call.
#pragma once

#include <cstdint>

namespace jade::gaussians {

/// Moves the means of `count` Gaussians by scale · damping(o) · Σ ε, ε normal.
struct NoiseStep {
  float* means = nullptr;                  ///< [N,3]
  const float* rotations = nullptr;        ///< [N,4] wxyz, of any length
  const float* log_scales = nullptr;       ///< [N,3]
  const float* logit_opacities = nullptr;  ///< [N]
  int64_t count = 0;
  float scale = 0;
  uint64_t seed = 0;  ///< ε of a Gaussian is a function of this and of its row
};

namespace cpu {
void add_noise(const NoiseStep& step);
}

namespace cuda {
/// On the current stream of the current device.
void add_noise(const NoiseStep& step);
}  // namespace cuda

}  // namespace jade::gaussians
