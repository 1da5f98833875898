// SPDX-License-Identifier: Apache-2.0
#include "jade/core/text.h"

#include "support/catch.h"

using namespace jade;

TEST_CASE("text: only ASCII letters change case", "[core]") {
  CHECK(in_small_letters("Frame_01.PNG, É") == "frame_01.png, É");
}

TEST_CASE("text: indices have the digits of the last one", "[core]") {
  CHECK(padded(0, 1) == "0");
  CHECK(padded(8, 9) == "8");
  CHECK(padded(8, 17) == "08");
  CHECK(padded(16, 17) == "16");
}

TEST_CASE("text: a listing names the first, and counts the others", "[core]") {
  CHECK(listing({}).empty());
  CHECK(listing({"", "b"}) == ", b");
  CHECK(listing({"a", "b"}, 2) == "a, b");
  CHECK(listing({"a", "b", "c", "d"}, 2) == "a, b and 2 more");
}
