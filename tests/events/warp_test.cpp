// SPDX-License-Identifier: Apache-2.0
#include "jade/events/warp.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

namespace jade::events {
namespace {

/// Two columns to the right and twice as far down; the last column has no destination.
torch::Tensor shift_map() {
  const auto axes = torch::meshgrid({torch::arange(4), torch::arange(6)}, "ij");
  torch::Tensor map = torch::stack({axes[1] + 2, axes[0] * 2}).to(torch::kFloat32);
  map.select(2, 5).fill_(std::nanf(""));
  return map;
}

TEST_CASE("warp: events go where the map leads, between pixels too", "[events]") {
  const auto moved =
      warp(EventStream::from_lists({1, 2.5}, {1, 0.5}, {7, 9}, {-1, 1}), shift_map(), {8, 8});
  REQUIRE(moved.events.size() == 2);
  CHECK(moved.dropped == 0);
  CHECK(moved.events.x().equal(torch::tensor({3.0F, 4.5F})));
  CHECK(moved.events.y().equal(torch::tensor({2.0F, 1.0F})));
  CHECK(moved.events.t_us().equal(torch::tensor({7, 9}, torch::kInt64)));
  CHECK(moved.events.polarity().equal(torch::tensor({-1, 1}, torch::kInt8)));
}

TEST_CASE("warp: events beside the image or the sensor are dropped and counted", "[events]") {
  const auto moved = warp(EventStream::from_lists({5, 2, 6.5, 1, NAN, 4}, {0, 1, 1, 2, 1, 3},
                                                  {1, 2, 3, 4, 5, 6}, {1, 1, 1, -1, 1, 1}),
                          shift_map(), {5, 8});
  // The first has no destination, the last leaves the image at the bottom; two are outside the
  // sensor.
  CHECK(moved.dropped == 4);
  CHECK(moved.events.t_us().equal(torch::tensor({2, 4}, torch::kInt64)));
}

}  // namespace
}  // namespace jade::events
