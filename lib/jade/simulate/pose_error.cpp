// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/pose_error.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "jade/core/check.h"
#include "jade/world/noise.h"

namespace jade::simulate {

PoseError::PoseError(double correlation_us, std::vector<int64_t> estimated_us, uint64_t seed)
    : correlation_us_(correlation_us), estimated_us_(std::move(estimated_us)), seed_(seed) {
  JADE_CHECK(!estimated_us_.empty(),
             "expected the time of at least one estimated pose, found none");
  std::sort(estimated_us_.begin(), estimated_us_.end());
  estimated_us_.erase(std::unique(estimated_us_.begin(), estimated_us_.end()), estimated_us_.end());
}

std::array<double, 6> PoseError::at(int64_t t_us) const {
  return correlation_us_ > 0 ? correlated(static_cast<double>(t_us)) : independent(t_us);
}

// White noise on a fine grid with the window exp(−(Δ/τ)²), whose autocorrelation is exp(−Δ²/2τ²);
// divided by the norm of the weights, so that the deviation is 1 for any position of the grid.
std::array<double, 6> PoseError::correlated(double t_us) const {
  constexpr double kGridSteps = 4, kReach = 4;  // grid steps per τ; reach in τ
  const double place = t_us / correlation_us_ * kGridSteps;
  std::array<double, 6> sum{};
  double squares = 0;
  const auto first = static_cast<int64_t>(std::ceil(place - kReach * kGridSteps));
  const auto last = static_cast<int64_t>(std::floor(place + kReach * kGridSteps));
  for (int64_t i = first; i <= last; ++i) {
    const double distance = (place - static_cast<double>(i)) / kGridSteps;
    const double weight = std::exp(-distance * distance);
    const auto noise = draw(i);
    for (size_t k = 0; k < 6; ++k) sum[k] += weight * noise[k];
    squares += weight * weight;
  }
  for (double& v : sum) v /= std::sqrt(squares);
  return sum;
}

// Weights whose squares sum to one, so that the deviation does not decrease between two samples.
std::array<double, 6> PoseError::independent(int64_t t_us) const {
  const auto after = std::lower_bound(estimated_us_.begin(), estimated_us_.end(), t_us);
  if (after == estimated_us_.end()) return draw(estimated_us_.back());
  if (*after == t_us || after == estimated_us_.begin()) return draw(*after);
  const int64_t before = *(after - 1);
  const double s = static_cast<double>(t_us - before) / static_cast<double>(*after - before);
  const double norm = std::hypot(1 - s, s);
  const auto a = draw(before), b = draw(*after);
  std::array<double, 6> mixed{};
  for (size_t k = 0; k < 6; ++k) mixed[k] = ((1 - s) * a[k] + s * b[k]) / norm;
  return mixed;
}

std::array<double, 6> PoseError::draw(int64_t stream) const {
  world::Draw generator(seed_, static_cast<uint64_t>(stream));
  std::array<double, 6> noise{};
  for (double& v : noise) v = generator.normal();
  return noise;
}

}  // namespace jade::simulate
