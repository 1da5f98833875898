// SPDX-License-Identifier: Apache-2.0
#include "jade/run/draw_clock.h"

#include "support/catch.h"

#include <thread>
#include <torch/types.h>

using namespace jade;

TEST_CASE("draw_clock: says how long it took once it is over", "[run]") {
  run::DrawClock clock(torch::kCPU);
  CHECK_FALSE(clock.seconds());
  for (const int milliseconds : {20, 1}) {
    clock.start();
    CHECK_FALSE(clock.seconds());
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    clock.stop();
    REQUIRE(clock.seconds());
    CHECK(*clock.seconds() >= 1e-3 * milliseconds);
    CHECK(*clock.seconds() < 5);
  }
}

TEST_CASE("draw_clock: measures a GPU without waiting for it", "[run][cuda]") {
  const torch::Device device(torch::kCUDA);
  const auto matrix = torch::rand({4096, 4096}, device);
  matrix.mm(matrix).sum().item<float>();
  run::DrawClock clock(device);
  clock.start();
  auto product = matrix;
  for (int i = 0; i < 50; ++i) product = product.mm(matrix).clamp(0, 1);
  clock.stop();
  CHECK_FALSE(clock.seconds());
  product.sum().item<float>();
  REQUIRE(clock.seconds());
  CHECK(*clock.seconds() > 1e-3);
}
