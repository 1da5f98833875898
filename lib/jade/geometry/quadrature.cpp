// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/quadrature.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::geometry {

Quadrature quadrature(QuadratureRule rule, int64_t samples) {
  JADE_CHECK(samples >= 3 && samples % 2 == 1,
             "expected an odd number of samples, 3 or more, found ", samples);
  const auto count = static_cast<double>(samples);
  Quadrature out;
  for (int64_t k = 0; k < samples; ++k) {
    const auto place = static_cast<double>(k);
    if (rule == QuadratureRule::kJittered) {
      out.u.push_back((place + 0.5) / count);
    } else {
      out.u.push_back(place / (count - 1));
    }
    out.weights.push_back(rule == QuadratureRule::kTrapezoid ? 1 / (count - 1) : 1 / count);
  }
  if (rule == QuadratureRule::kTrapezoid) {
    out.weights.front() /= 2;
    out.weights.back() /= 2;
  }
  return out;
}

torch::Tensor jittered_times(at::Generator& generator, int64_t steps, int64_t samples) {
  torch::Tensor place = torch::rand({steps, samples}, generator, torch::kFloat64);
  place.select(1, samples / 2).fill_(0.5);
  return (place + torch::arange(samples, torch::kFloat64)) / static_cast<double>(samples);
}

}  // namespace jade::geometry
