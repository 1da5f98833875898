// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/quadrature.h"

#include "jade/core/check.h"

namespace jade::geometry {

Quadrature quadrature(QuadratureRule rule, int64_t samples) {
  JADE_CHECK(samples >= 3 && samples % 2 == 1,
             "expected an odd number of samples, 3 or more, found ", samples);
  const auto count = static_cast<double>(samples);
  Quadrature out;
  for (int64_t k = 0; k < samples; ++k) {
    out.u.push_back(static_cast<double>(k) / (count - 1));
    out.weights.push_back(rule == QuadratureRule::kTrapezoid ? 1 / (count - 1) : 1 / count);
  }
  if (rule == QuadratureRule::kTrapezoid) {
    out.weights.front() /= 2;
    out.weights.back() /= 2;
  }
  return out;
}

}  // namespace jade::geometry
