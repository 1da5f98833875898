// SPDX-License-Identifier: Apache-2.0
#include "jade/events/ramps.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "random_events.h"

using namespace jade::events;
using namespace jade::test;

namespace {

/// Events of pixel (2, 1).
EventStream at_one_pixel(const std::vector<int64_t>& t, const std::vector<int8_t>& polarity) {
  const std::vector<float> x(t.size(), 2), y(t.size(), 1);
  return EventStream::from_lists(x, y, t, polarity);
}

/// Its windows.
std::vector<float> windows_of(const torch::Tensor& maps) {
  const torch::Tensor row = maps.select(1, 1).select(1, 2).contiguous();
  return {row.data_ptr<float>(), row.data_ptr<float>() + row.numel()};
}

using Windows = std::vector<float>;

}  // namespace

TEST_CASE("ramps: a step is spread over the time since the event before it", "[events]") {
  const auto events = at_one_pixel({0, 400}, {1, 1});
  const auto maps = ramped_windows(events, {0, 800}, 8, 1000, kSize);
  // The line of the first lies before the exposure.
  CHECK(windows_of(maps.positive) == Windows{0.25f, 0.25f, 0.25f, 0.25f, 0, 0, 0, 0});
  CHECK(windows_of(maps.negative) == Windows(8, 0));
}

TEST_CASE("ramps: a line begins at most the reach before its event", "[events]") {
  const auto maps = ramped_windows(at_one_pixel({100, 600}, {1, -1}), {0, 800}, 8, 200, kSize);
  CHECK(windows_of(maps.positive) == Windows{0.5f, 0, 0, 0, 0, 0, 0, 0});
  CHECK(windows_of(maps.negative) == Windows{0, 0, 0, 0, 0.5f, 0.5f, 0, 0});
}

TEST_CASE("ramps: an event after the exposure counts with its part inside", "[events]") {
  const auto events = at_one_pixel({700, 900}, {1, 1});
  const auto maps = ramped_windows(events, {0, 800}, 8, 400, kSize);
  CHECK(windows_of(maps.positive) == Windows{0, 0, 0, 0.25f, 0.25f, 0.25f, 0.25f, 0.5f});
}

TEST_CASE("ramps: without reach they are the counts", "[events]") {
  const auto events = random_events(4000, 1, 10000, 4).stream();
  const TimeWindow exposure{1003, 8017};
  const auto counts = map_exposure(events, exposure, 6, kSize).windows;
  const auto maps = ramped_windows(events, exposure, 8, 0, kSize);
  CHECK(worst(maps.positive, counts.positive) < 1e-4);
  CHECK(worst(maps.negative, counts.negative) < 1e-4);
  CHECK(worst(ramped_windows(events, exposure, 8, 3000, kSize).positive, counts.positive) > 0.1);
}

TEST_CASE("ramps: two events at one moment are steps, and all shares add up to the events",
          "[events]") {
  const auto events = at_one_pixel({300, 300, 310}, {1, 1, 1});
  const auto maps = ramped_windows(events, {0, 800}, 8, 100, kSize);
  CHECK(maps.positive.sum().item<float>() == Approx(3));
  CHECK(windows_of(maps.positive)[3] == Approx(2));  // the second and the third
  CHECK_THROWS_AS(ramped_windows(events, {0, 800}, 0, 100, kSize), jade::ContractError);
}
