// SPDX-License-Identifier: Apache-2.0
#include "jade/core/progress.h"

#include "support/catch.h"

namespace jade {
namespace {

TEST_CASE("duration_text: reads as a clock", "[core]") {
  CHECK(duration_text(5.2) == "0:05");
  CHECK(duration_text(245) == "4:05");
  CHECK(duration_text(3723) == "1:02:03");
}

TEST_CASE("Progress: off a terminal a report is due every ten seconds, not every step", "[core]") {
  Progress progress("work", 1000);
  int due = 0;
  for (int i = 0; i < 1000; ++i) due += progress.step() ? 1 : 0;
  CHECK(due <= 1);
}

}  // namespace
}  // namespace jade
