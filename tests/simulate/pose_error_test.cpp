// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/pose_error.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"

using namespace jade;
using namespace jade::simulate;

namespace {

constexpr int64_t kSeeds = 3000;
// Four standard errors of a mean or a correlation over all seeds; a deviation has 1/√2 of it.
const double kBound = 4 / std::sqrt(double(kSeeds));

/// [seeds, 6] at one time.
torch::Tensor errors_at(double correlation_us, const std::vector<int64_t>& estimated_us,
                        int64_t t_us) {
  std::vector<double> values;
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const auto e = PoseError(correlation_us, estimated_us, seed).at(t_us);
    values.insert(values.end(), e.begin(), e.end());
  }
  return torch::tensor(values, torch::kFloat64).view({kSeeds, 6});
}

void check_standard(const torch::Tensor& errors) {
  CHECK(errors.mean(0).abs().max().item<double>() < kBound);
  CHECK((errors.std(0) - 1).abs().max().item<double>() < kBound / std::sqrt(2.0));
  const auto r = torch::corrcoef(errors.t()) - torch::eye(6, torch::kFloat64);
  CHECK(r.abs().max().item<double>() < kBound);
}

/// The mean over the six components of the correlation between two times.
double correlation(const torch::Tensor& a, const torch::Tensor& b) {
  return ((a - a.mean(0)) * (b - b.mean(0))).mean(0).div(a.std(0) * b.std(0)).mean().item<double>();
}

}  // namespace

TEST_CASE("pose error: has deviation 1 at every time, at an estimated pose or not", "[simulate]") {
  const std::vector<int64_t> estimated{55000, 175000, 295000};
  for (const double correlation_us : {0.0, 200000.0}) {
    for (const int64_t t_us : {0, 5000, 55000, 90000, 115000, 175000, 400000}) {
      INFO(correlation_us << " " << t_us);
      check_standard(errors_at(correlation_us, estimated, t_us));
    }
  }
}

TEST_CASE("pose error: correlates as told", "[simulate]") {
  const std::vector<int64_t> estimated{55000, 175000};
  const auto now = errors_at(200000, estimated, 55000);
  for (const int64_t apart_us : {50000, 120000, 300000, 1000000}) {
    INFO(apart_us);
    const double expected = std::exp(-0.5 * std::pow(double(apart_us) / 200000, 2));
    CHECK(correlation(now, errors_at(200000, estimated, 55000 + apart_us)) ==
          Approx(expected).margin(kBound / std::sqrt(6.0)));
  }
  const auto alone = errors_at(0, estimated, 55000);
  CHECK(std::abs(correlation(alone, errors_at(0, estimated, 175000))) < kBound / std::sqrt(6.0));
  // Near an estimated pose its own error dominates.
  CHECK(correlation(alone, errors_at(0, estimated, 56000)) > 0.999);
}

TEST_CASE("pose error: depends on the seed and the time alone", "[simulate]") {
  const PoseError error(0, {30, 10, 20, 10}, 5), other(0, {30, 10, 20}, 6);
  CHECK(error.at(10) == PoseError(0, {10, 1000}, 5).at(10));
  CHECK(error.at(15) == PoseError(0, {10, 20}, 5).at(15));
  CHECK(error.at(10) != other.at(10));
  CHECK(PoseError(100, {10}, 5).at(10) == PoseError(100, {70}, 5).at(10));
  CHECK_THROWS_AS(PoseError(0, {}, 5), ContractError);
}
