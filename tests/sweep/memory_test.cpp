// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/memory.h"

#include "support/catch.h"

using namespace jade;

TEST_CASE("read_processes: bytes by process, and nothing of what is no number", "[sweep]") {
  const auto processes = sweep::read_processes("12, 300\n7, [N/A]\n\nNo devices\n12, 1\n9, 0\n");
  REQUIRE(processes.size() == 1);
  CHECK(processes.at(12) == int64_t{301} << 20);
}

TEST_CASE("may_start: what is free must hold the peak, the growth of the others and the margin",
          "[sweep]") {
  CHECK(sweep::may_start({0, {}, 0}, 1));            // nothing known: one starts
  CHECK_FALSE(sweep::may_start({1000, {5}, 0}, 1));  // the next one waits until its need is known
  CHECK(sweep::may_start({11, {}, 10}, 1));
  CHECK_FALSE(sweep::may_start({10, {}, 10}, 1));
  CHECK(sweep::may_start({14, {7}, 10}, 1));  // 10 + 3 + 1
  CHECK_FALSE(sweep::may_start({13, {7}, 10}, 1));
  // beyond the peak nothing more is reserved for them
  CHECK(sweep::may_start({11, {12, 10}, 10}, 1));
}
