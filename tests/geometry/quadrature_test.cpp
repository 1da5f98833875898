// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/quadrature.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "jade/core/error.h"

namespace jade::geometry {
namespace {

double integral(const Quadrature& sum, double (*f)(double)) {
  double total = 0;
  for (size_t k = 0; k < sum.u.size(); ++k) total += sum.weights[k] * f(sum.u[k]);
  return total;
}

TEST_CASE("quadrature: every rule takes the mean of a constant and of a line", "[geometry]") {
  for (const auto rule : {QuadratureRule::kEqual, QuadratureRule::kTrapezoid}) {
    for (const int64_t samples : {3, 5, 9, 17}) {
      const Quadrature sum = quadrature(rule, samples);
      CHECK(static_cast<int64_t>(sum.u.size()) == samples);
      CHECK(sum.u[static_cast<size_t>(samples / 2)] == 0.5);
      CHECK(integral(sum, [](double) { return 1.0; }) == Approx(1));
      CHECK(integral(sum, [](double u) { return u; }) == Approx(0.5));
    }
  }
}

TEST_CASE(
    "quadrature: equal weights at both ends integrate over K/(K-1) exposures, the trapezoid "
    "rule over one",
    "[geometry]") {
  const auto square = [](double u) { return (u - 0.5) * (u - 0.5); };
  // The variance of a uniform moment is its span squared over 12.
  const double equal = integral(quadrature(QuadratureRule::kEqual, 9), square) * 12;
  const double trapezoid = integral(quadrature(QuadratureRule::kTrapezoid, 9), square) * 12;
  CHECK(equal == Approx(10.0 / 8).epsilon(1e-9));  // (K + 1) / (K − 1), about (9/8)²
  CHECK(trapezoid == Approx(1 + 2.0 / 64).epsilon(1e-9));
  CHECK(quadrature(QuadratureRule::kTrapezoid, 9).weights.front() == 1.0 / 16);
  CHECK_THROWS_AS(quadrature(QuadratureRule::kEqual, 8), ContractError);
}

TEST_CASE("quadrature: some of a rule's moments take its mean of what is linear between them",
          "[geometry]") {
  for (const auto rule : {QuadratureRule::kEqual, QuadratureRule::kTrapezoid}) {
    const Quadrature all = quadrature(rule, 17), some = thinned(all, 4);
    REQUIRE(some.u == std::vector<double>{0, 0.25, 0.5, 0.75, 1});
    const auto roof = [](double u) { return std::abs(u - 0.25) + 3 * std::max(0.0, u - 0.75); };
    CHECK(integral(some, roof) == Approx(integral(all, roof)).epsilon(1e-12));
  }
  const Quadrature five = quadrature(QuadratureRule::kTrapezoid, 5);
  CHECK(thinned(quadrature(QuadratureRule::kTrapezoid, 9), 2).weights == five.weights);
  CHECK(thinned(five, 1).weights == five.weights);
  CHECK_THROWS_AS(thinned(five, 3), ContractError);
}

}  // namespace
}  // namespace jade::geometry
