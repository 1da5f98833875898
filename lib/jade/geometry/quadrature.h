// SPDX-License-Identifier: Apache-2.0
// The integral over an exposure as a sum over moments of it. Times are in units of the exposure:
// 0 is its start and 1 its end.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "jade/core/fields.h"

namespace jade::geometry {

enum class QuadratureRule { kEqual, kTrapezoid };

constexpr auto words_of(QuadratureRule) {
  return std::array{
      Word{"equal", QuadratureRule::kEqual,
           "the printed mean of equal steps, both ends at full weight: exact for frames made this "
           "way; for light it corresponds to an exposure K/(K-1) as long"},
      Word{"trapezoid", QuadratureRule::kTrapezoid, "the same moments, both ends at half weight"}};
}

/// The configuration group `exposure`.
struct ExposureOptions {
  QuadratureRule quadrature = QuadratureRule::kTrapezoid;
  int64_t samples = 17;
};

template <class V>
void describe(V& v, ExposureOptions& o) {
  v.field("quadrature", o.quadrature, "weights of the sharp images whose sum is an exposure");
  v.field("samples", o.samples,
          "number of sharp images, odd: renders per step in L_blur, L_sim and L_int; the paper's 9",
          Range{5, 65});
}

/// Moments of an exposure and their weights in its mean.
struct Quadrature {
  std::vector<double> u;        ///< [K], increasing
  std::vector<double> weights;  ///< [K], summing to 1
};

/// The moments of a rule, in equal steps from 0 to 1.
/// @throws ContractError for an even number of samples or fewer than 3.
Quadrature quadrature(QuadratureRule rule, int64_t samples);

/// Every `stride`-th moment of a rule, from the first to the last, with weights that give the mean
/// over all moments of a function that is linear between the remaining ones.
/// @throws ContractError unless `stride` leads from the first moment to the last.
Quadrature thinned(const Quadrature& all, int64_t stride);

}  // namespace jade::geometry
