// SPDX-License-Identifier: Apache-2.0
#include "jade/run/term_monitor.h"

#include "support/catch.h"

#include <limits>
#include <torch/types.h>

using namespace jade;

TEST_CASE("term monitor: names the step and the term that first stopped being finite", "[run]") {
  run::TermMonitor monitor;
  const auto watch = [&](int64_t step, double blur, double target) {
    monitor.watch({{"blur", torch::tensor(blur)}, {"target", torch::tensor(target)}}, step);
  };
  watch(5, 1, 2);
  watch(6, 1, 2);
  CHECK_NOTHROW(monitor.check());
  watch(7, 1, std::numeric_limits<double>::quiet_NaN());
  watch(8, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN());
  CHECK_THROWS_WITH(monitor.check(), Catch::Contains("step 7") && Catch::Contains("target") &&
                                         !Catch::Contains("blur"));
}
