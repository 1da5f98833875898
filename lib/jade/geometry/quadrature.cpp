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

Quadrature thinned(const Quadrature& all, int64_t stride) {
  const auto count = static_cast<int64_t>(all.u.size());
  JADE_CHECK(stride >= 1 && (count - 1) % stride == 0, "expected a divisor of ", count - 1,
             " as stride, found ", stride);
  Quadrature out;
  out.weights.assign(static_cast<size_t>((count - 1) / stride + 1), 0);
  for (int64_t k = 0; k < count; ++k) {
    const auto left = static_cast<size_t>(k / stride);
    const double share = static_cast<double>(k % stride) / static_cast<double>(stride);
    const double weight = all.weights[static_cast<size_t>(k)];
    out.weights[left] += (1 - share) * weight;
    if (share > 0) {
      out.weights[left + 1] += share * weight;
    } else {
      out.u.push_back(all.u[static_cast<size_t>(k)]);
    }
  }
  return out;
}

}  // namespace jade::geometry
