// SPDX-License-Identifier: Apache-2.0
#include "jade/train/draws.h"

#include "support/catch.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <torch/types.h>

#include "jade/core/error.h"
#include "train/bench.h"

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

TEST_CASE("pose draws: a fourth for the target leaves the three as they are, and the host knows it",
          "[train]") {
  train::PoseDraws three(3, torch::kCPU), four(3, torch::kCPU, 9, true),
      late(3, torch::kCPU, 9, true);
  CHECK(late.on_host(2000)[3] == four.at(2000)[3].item<int64_t>());
  std::array<int, 9> seen{};
  for (int64_t step = 1; step <= 1100; ++step) {
    const torch::Tensor drawn = four.at(step);
    REQUIRE(drawn.narrow(0, 0, 3).equal(three.at(step)));
    for (int64_t k = 0; k < 4; ++k) REQUIRE(drawn[k].item<int64_t>() == four.on_host(step)[k]);
    ++seen[static_cast<size_t>(four.on_host(step)[3])];
  }
  for (const int count : seen) CHECK(std::abs(count - 1100 / 9) < 50);
  CHECK(three.on_host(7)[2] == four.on_host(7)[2]);
}

TEST_CASE("term weights: those of the step, and none where nothing falls", "[train]") {
  losses::ObjectiveOptions options = train::printed_options().objective;
  CHECK_FALSE(train::TermWeights(options, 4000, torch::kCPU).at(1).defined());
  options.edi_weight_final = 0;
  train::TermWeights weights(options, 4000, torch::kCPU);
  CHECK(weights.at(3000).equal(torch::tensor({1.0f, 0.25f})));
  CHECK(weights.at(1).equal(torch::tensor({1.0f, static_cast<float>(1 - 1.0 / 4000)})));
}

TEST_CASE("draws: are new ones in every block of steps and every epoch", "[train]") {
  constexpr int64_t kBlockSteps = 1024, kLook = 50;
  train::PoseDraws poses(3, torch::kCPU, 9, true);
  std::vector<torch::Tensor> early, late;
  for (int64_t step = 1; step <= kLook; ++step) {
    early.push_back(poses.at(step).clone());
    late.push_back(poses.at(kBlockSteps + step).clone());
  }
  const torch::Tensor alike = torch::stack(early).eq(torch::stack(late)).sum(0);
  for (int64_t kind = 0; kind < 4; ++kind) {
    CHECK(alike[kind].item<int64_t>() < kLook / 3);  // by chance a ninth
  }
  train::ViewOrder order(3, 50);
  int64_t same = 0;
  for (int64_t step = 1; step <= 50; ++step) same += order.at(step) == order.at(50 + step);
  CHECK(same < 10);
}
