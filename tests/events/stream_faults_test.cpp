// SPDX-License-Identifier: Apache-2.0
#include "jade/events/stream_faults.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <vector>

#include "support/naming.h"

using namespace jade;
using namespace jade::events;

namespace {

std::string fault_of(const std::vector<int64_t>& times) {
  ClockOrder order;
  for (const int64_t t : times) order.add(t);
  CHECK(order.sorted() == std::is_sorted(times.begin(), times.end()));
  return order.fault();
}

std::vector<int64_t> steady(int64_t count) {
  std::vector<int64_t> times;
  for (int64_t i = 0; i < count; ++i) times.push_back(1000 * i);
  return times;
}

}  // namespace

TEST_CASE("stream faults: one polarity only", "[events]") {
  const torch::Tensor place = torch::zeros({2000}), t = torch::arange(2000);
  const auto fault = [&](int64_t brighter) {
    const torch::Tensor p = torch::arange(2000).lt(brighter).to(torch::kInt8) * 2 - 1;
    return polarity_fault({place, place, t, p.to(torch::kInt8)});
  };
  CHECK_THAT(fault(2000), test::naming("2000 of 2000", "one polarity"));
  CHECK_THAT(fault(1), test::naming("1 of 2000", "1999 of getting darker"));
  CHECK(fault(1000).empty());
  CHECK(polarity_fault({}).empty());
}

TEST_CASE("stream faults: event times with few digits", "[events]") {
  const int64_t count = 40000;
  const torch::Tensor place = torch::zeros({count});
  const torch::Tensor up = torch::ones({count}, torch::kInt8);
  const torch::Tensor fine = torch::arange(count) * 50;  // 2 s
  const auto fault = [&](int64_t step_us) {
    return resolution_fault(EventStream(place, place, fine - fine % step_us, up));
  };
  CHECK_THAT(fault(10000),
             test::naming("40000 events at 200 times", "10 ms apart", "six decimals"));
  CHECK_THAT(fault(1000), test::naming("1 ms apart"));
  CHECK(fault(100).empty());
  CHECK(resolution_fault(EventStream()).empty());
  // A sensor that reads out many pixels at once, in bursts.
  const torch::Tensor bursts = torch::arange(count).floor_divide(20) * 10;
  CHECK(resolution_fault(EventStream(place, place, bursts, up)).empty());
}

TEST_CASE("stream faults: frame times with few digits", "[events]") {
  const auto fault = [](int64_t period_us, int64_t step_us, int64_t length_us) {
    std::vector<TimeWindow> exposures;
    for (int64_t i = 0; i < 12; ++i) {
      const int64_t t = (i * period_us + step_us / 2) / step_us * step_us;
      exposures.push_back({t, t + length_us});
    }
    return resolution_fault(exposures);
  };
  CHECK_THAT(fault(33333, 10000, 0),
             test::naming("all of 12 in steps of 10 ms", "period of 33.636 ms"));
  CHECK_THAT(fault(33333, 1000, 10000), test::naming("steps of 1 ms"));
  CHECK_THAT(fault(16667, 10000, 0), test::naming("steps of 10 ms"));
  CHECK_THAT(fault(22222, 10000, 0), test::naming("steps of 10 ms"));
  CHECK(fault(33333, 1000, 0).empty());
  CHECK(fault(33333, 1, 10000).empty());
  CHECK(fault(50000, 10000, 10000).empty());
  // Left-out frames of a steady camera.
  CHECK(resolution_fault({{0, 0}, {50000, 0}, {150000, 0}, {200000, 0}, {350000, 0}, {400000, 0}})
            .empty());
  // A pause of one and a half periods.
  std::vector<TimeWindow> paused;
  for (int64_t i = 0; i < 10; ++i) paused.push_back({i * 100000 + (i > 3 ? 50000 : 0), 0});
  CHECK(resolution_fault(paused).empty());
  // Three frames half a period late, then one.
  CHECK(resolution_fault({{0, 0},
                          {150000, 0},
                          {200000, 0},
                          {300000, 0},
                          {450000, 0},
                          {500000, 0},
                          {600000, 0},
                          {750000, 0},
                          {800000, 0},
                          {900000, 0}})
            .empty());
  CHECK(resolution_fault({{0, 0}, {50000, 0}, {100000, 0}, {125000, 0}, {150000, 0}, {200000, 0}})
            .empty());
  // Sharp frames between those of a steady camera.
  CHECK(resolution_fault({{0, 0}, {50000, 0}, {100000, 0}, {145000, 0}, {150000, 0}, {200000, 0}})
            .empty());
}

TEST_CASE("stream faults: a clock that restarts is located", "[events]") {
  CHECK(fault_of({}).empty());
  CHECK(fault_of(steady(100)).empty());
  std::vector<int64_t> times = steady(100);
  for (size_t i = 60; i < 100; ++i) times[i] -= 40000;
  CHECK_THAT(fault_of(times), test::naming("go back by 0.039 s at event 60 of 100",
                                           "from 59000 to 20000 us", "restarted"));
  for (size_t i = 80; i < 100; ++i) times[i] -= 30000;
  CHECK_THAT(fault_of(times), test::naming("at event 60", "the largest of 2 such jumps"));
}

TEST_CASE("stream faults: packets and single damaged times are no restart", "[events]") {
  std::vector<int64_t> times = steady(100);
  std::swap(times[20], times[25]);
  CHECK(fault_of(times) == "event times were not in order; they have been sorted");
  times = steady(100);
  times[30] = 900000;
  times[50] = 0;
  CHECK(fault_of(times) == "event times were not in order; they have been sorted");
}

TEST_CASE("stream faults: silences between dense events, not pauses of a camera", "[events]") {
  std::vector<int64_t> times;
  const auto found = [&] {
    const auto count = int64_t(times.size());
    const torch::Tensor place = torch::zeros({count});
    return silences(
        {place, place, torch::tensor(times, torch::kInt64), torch::ones({count}, torch::kInt8)});
  };
  const auto fill = [&](double period_us, double from_us, double to_us) {
    for (double t = from_us; t < to_us; t += period_us) times.push_back(int64_t(t));
  };
  fill(50, 0, 100000);
  CHECK(found().empty());
  fill(50, 220000, 300000);  // 120 ms are missing
  REQUIRE(found().size() == 1);
  CHECK(found()[0].begin_us == 99950);
  CHECK(found()[0].end_us == 220000);

  // Packets of 4 ms, of which every third is missing.
  times.clear();
  for (int i = 0; i < 60; ++i) {
    if (i % 3 > 0) fill(50, 4000 * i, 4000 * (i + 1));
  }
  CHECK(found().size() == 19);

  // A camera that slows down, rests for 100 ms, and speeds up.
  times.clear();
  double t = 0;
  for (double period = 50; t < 400000;) {
    times.push_back(int64_t(t));
    const double speed = std::max(1e-3, std::abs(t - 200000) / 200000 - 0.25);
    period = std::min(50 / speed, 100000.0);
    t += period;
  }
  CHECK(found().empty());

  // Few events, and events in steps of the clock.
  times.clear();
  fill(5000, 0, 50000);
  fill(5000, 300000, 400000);
  CHECK(found().empty());
  times.clear();
  for (int i = 0; i < 200; ++i) times.insert(times.end(), 30, 1000 * i);
  CHECK(found().empty());
}

TEST_CASE("stream faults: coordinates that count from 1", "[events]") {
  const ImageSize size{40, 50};
  const int64_t count = 40 * 50 * 4;
  const torch::Tensor all = torch::arange(count), t = all * 3;
  const torch::Tensor x = all.remainder(50).to(torch::kFloat32);
  const torch::Tensor y = all.floor_divide(50).remainder(40).to(torch::kFloat32);
  const torch::Tensor p = torch::ones({count}, torch::kInt8);
  CHECK_THAT(one_based_fault({x + 1, y + 1, t, p}, size), test::naming("1 to 50 and 40"));
  CHECK(one_based_fault({x, y, t, p}, size).empty());
  CHECK(one_based_fault({x + 1, y, t, p}, size).empty());
  CHECK(one_based_fault({x + 2, y + 2, t, p}, size).empty());
  CHECK(one_based_fault({x + 1, y + 1, t, p}, {41, 51}).empty());
  CHECK(one_based_fault({}, size).empty());
}

TEST_CASE("stream faults: places between 0 and 1, and below 0, are named", "[events]") {
  const int64_t count = 2000;
  const torch::Tensor all = torch::arange(count), t = all * 20;
  const torch::Tensor x = all.remainder(50).to(torch::kFloat32),
                      y = all.floor_divide(7).remainder(40).to(torch::kFloat32);
  const torch::Tensor p = torch::ones({count}, torch::kInt8);
  CHECK_THAT(place_fault({x / 50, y / 40, t, p}), test::naming("normalised"));
  CHECK(place_fault({x, y, t, p}).empty());
  CHECK(place_fault({x - 5, y - 5, t, p}).empty());  // as rectified events may lie
  CHECK(place_fault({x, y.clamp_max(1), t, p}).empty());
  CHECK_THAT(place_fault({x, y - 40, t, p}), test::naming("y below 0 in 100 %", "down to -40"));
  CHECK_THAT(place_fault({x - 25, y - 20, t, p}), test::naming("x below 0", "and y below 0"));
  const torch::Tensor lost = x.clone();
  lost[3] = NAN;
  CHECK(place_fault({lost, y, t, p}).empty());
}

TEST_CASE("stream faults: copies of nearly all events are removed, single ones stay", "[events]") {
  const int64_t count = 20000;
  const torch::Tensor all = torch::arange(count);
  const EventStream once(
      all.remainder(50).to(torch::kFloat32), all.floor_divide(7).remainder(40).to(torch::kFloat32),
      all.floor_divide(5) * 20, (all.remainder(3).gt(0).to(torch::kInt8) * 2 - 1).to(torch::kInt8));
  const auto at = [&](const torch::Tensor& index) {
    return EventStream(once.x().index_select(0, index), once.y().index_select(0, index),
                       once.t_us().index_select(0, index), once.polarity().index_select(0, index));
  };
  CHECK(without_copies(once).copies == 0);
  CHECK(without_copies({}).copies == 0);
  const DistinctEvents twice = without_copies(at(all.repeat_interleave(2)));
  CHECK(twice.copies == count);
  CHECK(twice.events.x().equal(once.x()));
  CHECK(twice.events.t_us().equal(once.t_us()));
  // Two files that share the last half.
  const torch::Tensor half = torch::cat({all.slice(0, 0, 10000), all.slice(0, 10000).repeat(2)});
  CHECK(without_copies(at(std::get<0>(half.sort()))).copies == Approx(10000).margin(4096));
  // A tenth of the pixels fires twice at once.
  const torch::Tensor some = torch::cat({all, all.slice(0, 0, count, 10)});
  CHECK(without_copies(at(std::get<0>(some.sort()))).copies == 0);
}
