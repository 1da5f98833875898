// SPDX-License-Identifier: Apache-2.0
#include "jade/events/counts.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/events/exposure_maps.h"
#include "random_events.h"
#include "support/devices.h"

using namespace jade::events;
using namespace jade::test;

TEST_CASE("count events: NaN, infinite and far coordinates touch nothing", "[events]") {
  const float nan = std::nanf(""), inf = INFINITY;
  const std::vector<float> x{nan, 1, inf, -inf, 1e30f, -1, 17, 3, 3},
      y{1, nan, 1, 1, 1, 2, 2, 13, -1};
  const auto events =
      EventStream::from_lists(x, y, std::vector<int64_t>(9, 0), std::vector<int8_t>(9, 1));
  CHECK(count_events(events, {0, 1}, kSize).abs().sum().item<int64_t>() == 0);
}

TEST_CASE("count events: weights on the image are kept for events that overlap its edge",
          "[events]") {
  const auto events = EventStream::from_lists({-0.25f, 16.5f}, {3, 12.5f}, {0, 0}, {1, 1});
  const auto density = event_density(events, kSize);
  CHECK(density[3][0].item<float>() == 0.75f);
  CHECK(density[12][16].item<float>() == 0.25f);
  CHECK(density.sum().item<float>() == 1.0f);
}

TEST_CASE("signed count: positive less negative events at every pixel", "[events]") {
  const auto events = random_events(500, 1.5f, 1000, 6);
  const auto expected = slow_bins(events, 0, 1000, 1)[0];
  const auto found = signed_count(events.stream(), kSize);
  CHECK(found.scalar_type() == torch::kFloat32);
  CHECK(worst(found, expected) < 1e-4);
  CHECK(found.min().item<float>() < 0);
  CHECK(signed_count(EventStream(), kSize).eq(0).all().item<bool>());
}

TEST_CASE("count events: the same bits for any number of threads and order of equal times",
          "[events]") {
  auto events = random_events(400000, 1.5f, 1000, 3);
  const std::vector<int64_t> knots{0, 10, 400, 401, 1000};
  const int threads = at::get_num_threads();
  at::set_num_threads(1);
  const auto one = count_events(events.stream(), knots, kSize);
  for (const int n : {2, 3, 7}) {
    at::set_num_threads(n);
    CHECK(torch::equal(count_events(events.stream(), knots, kSize), one));
  }
  at::set_num_threads(threads);
  for (size_t i = 0; i + 1 < events.t.size(); i += 2) {
    if (events.t[i] != events.t[i + 1]) continue;
    std::swap(events.x[i], events.x[i + 1]);
    std::swap(events.y[i], events.y[i + 1]);
    std::swap(events.p[i], events.p[i + 1]);
  }
  CHECK(torch::equal(count_events(events.stream(), knots, kSize), one));
}

TEST_CASE("count events: a GPU gives the CPU's bits", "[events][cuda]") {
  const auto events = random_events(200000, 1.5f, 100000, 6).stream();
  std::vector<int64_t> knots;
  // more spans than one launch supports
  for (int64_t k = 0; k <= 100; ++k) knots.push_back(k * 997);
  const auto on_gpu = count_events(events.to(torch::kCUDA), knots, kSize);
  CHECK(torch::equal(on_gpu.cpu(), count_events(events, knots, kSize)));
  CHECK(count_events(EventStream().to(torch::kCUDA), knots, kSize).abs().sum().item<int64_t>() ==
        0);
}
