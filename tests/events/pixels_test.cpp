// SPDX-License-Identifier: Apache-2.0
#include "jade/events/pixels.h"

#include "support/catch.h"

#include <ATen/Parallel.h>
#include <cmath>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "random_events.h"

using namespace jade::events;
using namespace jade::test;

namespace {

/// In an image of 2x3 pixels: twice pixel (0,0), once pixel (1,2), three outside, one NaN.
const EventStream kEvents = EventStream::from_lists(
    {-0.5F, 0.49F, 2.49F, 2.5F, -0.51F, 1, std::nanf("")}, {0, -0.5F, 1.49F, 0, 0, 1.5F, 0},
    {1, 2, 3, 4, 5, 6, 7}, {1, -1, 1, 1, 1, 1, 1});

}  // namespace

TEST_CASE("pixels: coordinates are rounded to the nearest pixel, NaN is in none", "[events]") {
  const torch::Tensor expected = torch::tensor({2, 0, 0, 0, 0, 1}, torch::kInt64).view({2, 3});
  CHECK(pixel_counts(kEvents, {2, 3}).equal(expected));
  CHECK(pixel_counts({}, {2, 3}).eq(0).all().item<bool>());
  CHECK_THROWS_AS(pixel_counts({}, {0, 0}), jade::ContractError);
}

TEST_CASE("pixels: threads count all events together", "[events]") {
  const Lists events = random_events(4 * kEventGrain + 1, 2, 1000, /*seed=*/1);
  std::vector<int64_t> expected(size_t(kSize.height * kSize.width), 0);
  for (size_t i = 0; i < events.x.size(); ++i) {
    const int64_t at = pixel_of(events.x[i], events.y[i], kSize);
    if (at >= 0) ++expected[size_t(at)];
  }
  const int threads = at::get_num_threads();
  at::set_num_threads(4);
  const torch::Tensor counts = pixel_counts(events.stream(), kSize);
  at::set_num_threads(threads);
  CHECK(counts.flatten().equal(torch::tensor(expected, torch::kInt64)));
}

TEST_CASE("pixels: a mask keeps events of its pixels and those outside, in order", "[events]") {
  const torch::Tensor mask = torch::tensor({0, 1, 1, 1, 1, 1}).view({2, 3}).to(torch::kBool);
  const EventStream kept = kEvents.select(kept_by(mask, kEvents));
  CHECK(kept.t_us().equal(torch::tensor({3, 4, 5, 6, 7}, torch::kInt64)));
  CHECK(kEvents.select(kept_by(mask.logical_not(), kEvents)).size() == 6);
  CHECK_THROWS_AS(kept_by(mask.to(torch::kInt8), kEvents), jade::ContractError);
}
