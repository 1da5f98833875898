// SPDX-License-Identifier: Apache-2.0
#include "jade/core/median.h"

#include "support/catch.h"

using namespace jade;

TEST_CASE("median: of two middle values it is the upper one", "[core]") {
  CHECK(median_of<int>({}) == 0);
  CHECK(median_of<double>({3, 1, 2}) == 2);
  CHECK(median_of<int>({4, 1, 3, 2}) == 3);
}

TEST_CASE("median: a step has no sign", "[core]") {
  CHECK(median_step<int64_t>({0, 50000, 100000, 300000}) == 50000);
  CHECK(median_step<double>({5, 3, 1}) == 2);
  CHECK(median_step<double>({5}) == 0);
}
