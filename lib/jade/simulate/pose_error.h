// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace jade::simulate {

/// The error of estimated poses in units of its standard deviation: six independent Gaussian
/// processes of time (three for the rotation, three for the centre), with mean 0 and deviation 1 at
/// every time. Depends only on the seed and the time, so calls may be in any order.
class PoseError {
 public:
  /// @param correlation_us  τ: errors at a time distance Δ have correlation exp(−Δ²/2τ²). 0: they
  ///   are independent at the times `estimated_us`, and interpolated in between
  /// @param estimated_us    in any order, at least one
  PoseError(double correlation_us, std::vector<int64_t> estimated_us, uint64_t seed);

  std::array<double, 6> at(int64_t t_us) const;

 private:
  std::array<double, 6> correlated(double t_us) const;
  std::array<double, 6> independent(int64_t t_us) const;
  std::array<double, 6> draw(int64_t stream) const;

  double correlation_us_;
  std::vector<int64_t> estimated_us_;  // increasing
  uint64_t seed_;
};

}  // namespace jade::simulate
