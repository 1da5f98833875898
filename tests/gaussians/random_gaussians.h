// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "jade/core/random.h"
#include "jade/gaussians/gaussian_model.h"

namespace jade::test {
/// Plausible Gaussians, deterministic for the same arguments.
inline splat::Gaussians random_gaussians(int64_t count, int64_t coefficients, uint64_t seed = 1) {
  at::Generator generator = make_generator(seed, "test Gaussians");
  const auto normal = [&](std::vector<int64_t> shape) {
    return at::randn(shape, generator, torch::kFloat32);
  };
  splat::Gaussians g;
  g.means = normal({count, 3});
  g.rotations = normal({count, 4});
  g.log_scales = normal({count, 3}) * 0.5 - 3;
  g.logit_opacities = normal({count});
  g.sh = normal({count, coefficients, 3}) * 0.3;
  return g;
}

}  // namespace jade::test
