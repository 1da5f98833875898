// SPDX-License-Identifier: Apache-2.0
// The exploration noise of 3DGS-MCMC over plain pointers; noise_math.h has its arithmetic. Private
// to this folder: others use mcmc.h.
#pragma once

#include <cstdint>

namespace jade::gaussians {

/// Adds scale · damping(o) · Σ ε to the means of `count` Gaussians, ε normal.
struct NoiseStep {
  float* means = nullptr;                  ///< [N,3]
  const float* rotations = nullptr;        ///< [N,4] wxyz, not normalised
  const float* log_scales = nullptr;       ///< [N,3]
  const float* logit_opacities = nullptr;  ///< [N]
  int64_t count = 0;
  float scale = 0;
  uint64_t seed = 0;  ///< ε of a Gaussian depends only on this seed and its row
};

namespace cpu {
void add_noise(const NoiseStep& step);
}

namespace cuda {
/// Runs on the current stream of the current device.
void add_noise(const NoiseStep& step);
}  // namespace cuda

}  // namespace jade::gaussians
