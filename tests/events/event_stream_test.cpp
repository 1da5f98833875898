// SPDX-License-Identifier: Apache-2.0
#include "jade/events/event_stream.h"

#include "support/catch.h"

#include <cmath>
#include <limits>
#include <torch/types.h>

#include "jade/core/error.h"

using namespace jade::events;

namespace {

EventStream at_times(const std::vector<int64_t>& t_us) {
  const size_t n = t_us.size();
  return EventStream::from_lists(std::vector<float>(n, 1), std::vector<float>(n, 2), t_us,
                                 std::vector<int8_t>(n, 1));
}

}  // namespace

TEST_CASE("event stream: windows are half-open", "[events]") {
  const auto events = at_times({10, 20, 20, 30, 40});
  CHECK(events.slice(20, 30).size() == 2);
  CHECK(events.slice(10, 41).size() == 5);
  CHECK(events.slice(10, 40).size() == 4);
  CHECK(events.slice(11, 20).size() == 0);
  CHECK(events.slice(20, 20).empty());
  CHECK(events.slice(30, 10).empty());
  CHECK(events.slice(-100, 1000).size() == 5);
  CHECK(events.count_before(20) == 1);
  CHECK(events.first_us() == 10);
  CHECK(events.last_us() == 40);
}

TEST_CASE("event stream: slices partition a stream at any knots", "[events]") {
  const auto events = at_times({0, 1, 1, 1, 2, 3, 5, 8, 13});
  int64_t total = 0;
  for (int64_t t = 0; t < 14; t += 2) total += events.slice(t, t + 2).size();
  CHECK(total == events.size());
}

TEST_CASE("event stream: slices and copies share the arrays and keep them alive", "[events]") {
  EventStream slice;
  const float* x = nullptr;
  {
    const auto events = at_times({1, 2, 3, 4});
    x = events.x().const_data_ptr<float>();
    slice = events.slice(2, 4).slice(3, 100);
  }
  REQUIRE(slice.size() == 1);
  CHECK(slice.x().const_data_ptr<float>() == x + 2);
  CHECK(slice.x().item<float>() == 1);
  CHECK(slice.t_us().item<int64_t>() == 3);
}

TEST_CASE("event stream: bad arrays are refused", "[events]") {
  CHECK_THROWS_AS(at_times({1, 3, 2}), jade::ContractError);
  CHECK_THROWS_AS(EventStream::from_lists({1}, {1, 2}, {1}, {1}), jade::ContractError);
  CHECK_THROWS_AS(EventStream::from_lists({1}, {1}, {1}, {0}), jade::ContractError);
  CHECK_THROWS_AS(EventStream(torch::zeros({1}, torch::kFloat64), torch::zeros({1}),
                              torch::zeros({1}, torch::kInt64), torch::ones({1}, torch::kInt8)),
                  jade::ContractError);
  CHECK_THROWS_AS(EventStream().first_us(), jade::ContractError);
  CHECK(EventStream().slice(0, 10).empty());
}

TEST_CASE("event stream: problems are counted by kind", "[events]") {
  const float nan = std::nanf(""), inf = std::numeric_limits<float>::infinity();
  const std::vector<float> x{0, 9, nan, 5, -0.5f, 9.5f, 10, -1, 4, inf};
  const std::vector<float> y{0, 7, 3, nan, 0, 7.5f, 0, 0, 1e9f, 3};
  const auto events =
      EventStream::from_lists(x, y, std::vector<int64_t>(10, 0), std::vector<int8_t>(10, -1));
  const auto problems = count_problems(events, {8, 10});
  CHECK(problems.not_finite == 3);
  CHECK(problems.outside == 3);
}
