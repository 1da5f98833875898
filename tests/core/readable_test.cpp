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

TEST_CASE("readable: numbers without exponents, unless they are tiny", "[core]") {
  CHECK(readable(0) == "0");
  CHECK(readable(1e8) == "100,000,000");
  CHECK(readable(9e15) == "9,000,000,000,000,000");
  CHECK(readable(39283.7) == "39,283.7");
  CHECK(readable(392837.4) == "392,837");
  CHECK(readable(0.3f) == "0.3");
  CHECK(readable(-0.0001) == "-0.0001");
  CHECK(readable(1e-8) == "1e-8");
  CHECK(readable(99999.99, 5) == "100,000");
}

TEST_CASE("readable: a time in its unit", "[core]") {
  CHECK(about_time(0.2) == "about 1 s");
  CHECK(about_time(40) == "about 40 s");
  CHECK(about_time(483) == "about 8 min");
  CHECK(about_time(9000) == "about 2.5 h");
}
