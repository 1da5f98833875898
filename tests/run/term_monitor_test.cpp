// SPDX-License-Identifier: Apache-2.0
#include "jade/run/term_monitor.h"

#include "support/catch.h"

#include <limits>
#include <torch/types.h>

#include "jade/core/error.h"
#include "support/naming.h"

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

TEST_CASE("term monitor: steps whose terms alternate are distinguished", "[run]") {
  run::TermMonitor monitor;
  const auto watch = [&](int64_t step, double blur) {
    std::vector<losses::NamedTerm> terms{{"blur", torch::tensor(blur)},
                                         {"edi_gray", torch::tensor(1.0)}};
    if (step % 2 == 1) terms.push_back({"route_render", torch::tensor(1.0)});
    monitor.watch(terms, step);
  };
  for (int64_t step = 11; step < 15; ++step) watch(step, 1);
  CHECK_NOTHROW(monitor.check());
  watch(15, 1);
  watch(16, 1);
  watch(17, 1);
  watch(18, std::numeric_limits<double>::quiet_NaN());
  watch(19, std::numeric_limits<double>::quiet_NaN());
  CHECK_THROWS_NAMING(NumericError, monitor.check(), "step 18", "NaN or Inf", "blur");
}
