// SPDX-License-Identifier: Apache-2.0
#include "jade/kernel/host_device.h"

#include "support/catch.h"

#include <limits>

using namespace jade;

TEMPLATE_TEST_CASE("host_device: bounds and choices, NaN included", "[kernel]", float, double) {
  using T = TestType;
  const T nan = std::numeric_limits<T>::quiet_NaN(), infinity = std::numeric_limits<T>::infinity();
  CHECK(kernel::min(T(-2), T(3)) == T(-2));
  CHECK(kernel::max(T(-2), T(3)) == T(3));
  CHECK(kernel::abs(T(-2.5)) == T(2.5));
  CHECK(kernel::select(true, T(1), T(2)) == T(1));
  CHECK(kernel::select(false, T(1), T(2)) == T(2));
  // A comparison with NaN fails, so the second argument is returned.
  CHECK(kernel::min(nan, T(3)) == T(3));
  CHECK(kernel::max(nan, T(3)) == T(3));
  CHECK(kernel::within(T(-4), T(4)));
  CHECK_FALSE(kernel::within(T(4.5), T(4)));
  CHECK_FALSE(kernel::within(-infinity, T(4)));
  CHECK_FALSE(kernel::within(nan, T(4)));
  CHECK(kernel::sqrt(T(9)) == T(3));
  CHECK(kernel::exp2(T(-3)) == T(0.125));
  CHECK(kernel::log2(T(32)) == T(5));
  CHECK(kernel::fma(T(2), T(3), T(4)) == T(10));
}
