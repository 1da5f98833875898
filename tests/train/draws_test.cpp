// SPDX-License-Identifier: Apache-2.0
#include "jade/train/draws.h"

#include "support/catch.h"

#include <algorithm>
#include <torch/types.h>

using namespace jade;

TEST_CASE("view order: every epoch shows every view once, whatever the step it is asked from",
          "[train]") {
  train::ViewOrder order(3, 7), late(3, 7);
  std::vector<int64_t> seen;
  for (int64_t step = 8; step <= 14; ++step) seen.push_back(order.at(step));
  CHECK(late.at(14) == seen.back());
  std::sort(seen.begin(), seen.end());
  CHECK(seen == std::vector<int64_t>{0, 1, 2, 3, 4, 5, 6});
  train::PoseDraws draws(3, torch::kCPU), same(3, torch::kCPU);
  const auto at_2000 = draws.at(2000);
  same.at(1);
  CHECK(same.at(2000).equal(at_2000));
}
