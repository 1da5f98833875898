// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/cpu/pack.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace m = jade::splat::math;

namespace {

/// The largest error of `packed` against `exact` over many arguments, as measured by `error`.
template <class P, class Packed, class Exact, class Error>
double worst(double first, double last, const Packed& packed, const Exact& exact,
             const Error& error) {
  using T = typename P::Scalar;
  constexpr int kSteps = 20000;
  double most = 0;
  for (int i = 0; i < kSteps; ++i) {
    const T x = static_cast<T>(first + (last - first) * i / (kSteps - 1));
    const P found = packed(P(x));
    for (int lane = 0; lane < P::kLanes; ++lane) {
      most = std::max(most, error(double(found.v[lane]), exact(double(x))));
    }
  }
  return most;
}

double relative(double found, double exact) { return std::abs(found / exact - 1); }
double absolute(double found, double exact) { return std::abs(found - exact); }

template <class P>
void check_functions(double rounding) {
  const auto exp2 = [](P x) { return m::exp2(x); };
  const auto exp2_of = [](double x) { return std::exp2(x); };
  CHECK(worst<P>(-126, 126, exp2, exp2_of, relative) < rounding);
  const auto exp = [](P x) { return m::exp(x); };
  const auto exp_of = [](double x) { return std::exp(x); };
  CHECK(worst<P>(-80, 80, exp, exp_of, relative) < rounding);
  const auto log2 = [](P x) { return m::log2(x); };
  const auto log2_of = [](double x) { return std::log2(x); };
  CHECK(worst<P>(1.0 / 255, 3, log2, log2_of, absolute) < 2 * rounding);
  CHECK(worst<P>(1e-30, 1e-20, log2, log2_of, relative) < rounding);
  CHECK(worst<P>(1e20, 1e30, log2, log2_of, relative) < rounding);
}

}  // namespace

TEST_CASE("pack: exp2, exp and log2 are those of the standard library to rounding",
          "[splat][cpu]") {
  check_functions<m::Pack<float, 4>>(4e-7);
  check_functions<m::Pack<double, 4>>(1e-13);
}

TEST_CASE("pack: exp2 and log2 are exact where powers of two meet", "[splat][cpu]") {
  using P = m::Pack<float, 4>;
  for (int n = -126; n <= 126; ++n) {
    CAPTURE(n);
    CHECK(m::exp2(P(n)).v[0] == std::ldexp(1.0f, n));
    CHECK(m::log2(P(std::ldexp(1.0f, n))).v[0] == float(n));
  }
}

TEST_CASE("pack: log2 of nothing is below the smallest alpha", "[splat][cpu]") {
  using P = m::Pack<float, 4>;
  for (const float nothing : {0.0f, std::numeric_limits<float>::denorm_min(), 1e-39f}) {
    CHECK(m::log2(P(nothing)).v[0] <= -126.0f);
  }
}
