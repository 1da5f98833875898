// SPDX-License-Identifier: Apache-2.0
#include "jade/core/readable.h"

#include "support/catch.h"

using namespace jade;

TEST_CASE("readable: digits in groups of three", "[core]") {
  CHECK(grouped(0) == "0");
  CHECK(grouped(999) == "999");
  CHECK(grouped(39280) == "39,280");
  CHECK(grouped(-123456) == "-123,456");
  CHECK(grouped(1234567) == "1,234,567");
}

TEST_CASE("readable: a time in its unit", "[core]") {
  CHECK(about_time(0.2) == "about 1 s");
  CHECK(about_time(40) == "about 40 s");
  CHECK(about_time(483) == "about 8 min");
  CHECK(about_time(9000) == "about 2.5 h");
}
