// SPDX-License-Identifier: Apache-2.0
#include "jade/events/time_unit.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"

using namespace jade::events;

TEST_CASE("time unit: that in which events meet the exposures", "[events]") {
  const TimeWindow exposures{1000000, 3000000};
  CHECK(guess_time_unit(0.9e6, 3.1e6, false, exposures) == TimeUnit::kUs);
  CHECK(guess_time_unit(0.9e9, 3.1e9, false, exposures) == TimeUnit::kNs);
  CHECK(guess_time_unit(0.9, 3.1, true, exposures) == TimeUnit::kS);
  CHECK(guess_time_unit(0, 3.5e6, false, exposures) == TimeUnit::kUs);
  CHECK(guess_time_unit(0, 3.5e9, false, exposures) == TimeUnit::kNs);
  CHECK(guess_time_unit(8e12, 9e12, false, exposures) == std::nullopt);
  CHECK(guess_time_unit(0, 5, true, {}) == TimeUnit::kS);
  CHECK(guess_time_unit(0, 5, false, {}) == TimeUnit::kUs);
}

TEST_CASE("time unit: events that go on long before and behind the exposures", "[events]") {
  // 100 s of events and a second of frames: in ns they would cover a twentieth of these.
  const TimeWindow exposures{50000, 1050000};
  CHECK(guess_time_unit(0, 1e8, false, exposures) == TimeUnit::kUs);
  CHECK(guess_time_unit(0, 1e11, false, exposures) == TimeUnit::kNs);
  // Events that end early are accepted, although a larger unit would cover all exposures.
  CHECK(guess_time_unit(0, 3e8, false, exposures) == TimeUnit::kNs);
  CHECK(guess_time_unit(0, 3e5, false, exposures) == TimeUnit::kUs);
  CHECK(guess_time_unit(0, 1.0e9, false, exposures) == TimeUnit::kNs);
  CHECK(guess_time_unit(0, 1.0, true, exposures) == TimeUnit::kS);
}

TEST_CASE("time unit: whole numbers of today's clock in ns are nothing else", "[events]") {
  const double first = 1.7e18;
  CHECK(guess_time_unit(first, first + 1e9, false, {}) == TimeUnit::kNs);
  const auto begin_us = static_cast<int64_t>(first / 1000);
  CHECK(guess_time_unit(first, first + 1e9, false, TimeWindow{begin_us, begin_us + 1000000}) ==
        TimeUnit::kNs);
  // Frames on an unrelated clock overlap the events in no unit.
  CHECK(guess_time_unit(first, first + 1e9, false, TimeWindow{0, 1000000}) == std::nullopt);
  const auto start = torch::tensor(std::vector<int64_t>{1700000000000000000});
  CHECK(guess_exposure_unit(start, start + 4000000, "t", "") == TimeUnit::kNs);
  CHECK(guess_exposure_unit(start, start, "t", "") == TimeUnit::kNs);
  const auto start_us = torch::tensor(std::vector<int64_t>{1700000000000000});
  CHECK(guess_exposure_unit(start_us, start_us + 4000, "t", "") == TimeUnit::kUs);
}

TEST_CASE("time unit: milliseconds only where frames or events fit nothing else", "[events]") {
  const auto unit_of = [](double length, double period, bool whole = false) {
    torch::Tensor start = 1000 + period * torch::arange(8, torch::kFloat64);
    torch::Tensor end = start + length;
    if (whole) start = start.to(torch::kInt64), end = end.to(torch::kInt64);
    return guess_exposure_unit(start, end, "t", "");
  };
  for (const bool whole : {false, true}) {
    CHECK(unit_of(40, 100, whole) == TimeUnit::kMs);
    CHECK(unit_of(11, 33, whole) == TimeUnit::kMs);
    CHECK(unit_of(3, 33, whole) == TimeUnit::kMs);
    CHECK(unit_of(90, 1000, whole) == TimeUnit::kUs);  // 1,000 frames per second
    CHECK(unit_of(100, 115, whole) == TimeUnit::kMs);
    CHECK(unit_of(190, 210, whole) == TimeUnit::kUs);  // below 5,000 per second
    CHECK(unit_of(5000, 40000, whole) == TimeUnit::kUs);
    CHECK(unit_of(5e6, 2e7, whole) == TimeUnit::kNs);  // 50 frames per second
    CHECK(unit_of(5e6, 6e6, whole) == TimeUnit::kUs);
  }
  CHECK(unit_of(0.04, 0.1) == TimeUnit::kS);
  CHECK(unit_of(1, 2) == TimeUnit::kS);
  CHECK(unit_of(0.2, 20) == TimeUnit::kS);
  CHECK(guess_exposure_unit(torch::tensor({1000., 1100.}), torch::tensor({1040., 1140.}), "t",
                            "") == TimeUnit::kUs);
  const TimeWindow exposures{1000000, 3000000};
  CHECK(guess_time_unit(900, 3100, true, exposures) == TimeUnit::kMs);
  CHECK(guess_time_unit(900, 3100, false, exposures) == TimeUnit::kMs);
  CHECK(guess_time_unit(0, 3100, true, exposures) == TimeUnit::kMs);
  CHECK(guess_time_unit(900, 3100, true, {}) == TimeUnit::kS);
}

TEST_CASE("time unit: frames that are too slow for a camera beside an event sensor", "[events]") {
  CHECK_FALSE(is_too_slow(4e6, 5e6));
  CHECK_FALSE(is_too_slow(2e4, 2e7));
  CHECK(is_too_slow(4e6, 4e7));
  CHECK(is_too_slow(1.1e7, 0));
}

TEST_CASE("time unit: implausible exposures say what to do", "[events]") {
  const auto start = torch::zeros({3}, torch::kInt64);
  CHECK_THROWS_WITH(
      guess_exposure_unit(start, start + 3, "t.npz", "give the unit"),
      Catch::StartsWith("t.npz: the median exposure is 3") && Catch::EndsWith("; give the unit"));
  CHECK(guess_exposure_unit(start, start, "t", "") == TimeUnit::kUs);
  const auto seconds = start.to(torch::kFloat64);
  CHECK(guess_exposure_unit(seconds, seconds, "t", "") == TimeUnit::kS);
  CHECK(guess_exposure_unit(seconds, seconds + 0.02, "t", "") == TimeUnit::kS);
}

TEST_CASE("time unit: lone times without a fraction in floating point are microseconds",
          "[events]") {
  const auto unit_of = [](const torch::Tensor& times) {
    return guess_exposure_unit(times, times, "t", "");
  };
  const auto whole = torch::tensor({1000000., 1050000., 1100001.}, torch::kFloat64);
  CHECK(unit_of(whole) == TimeUnit::kUs);
  CHECK(unit_of(whole * 1000 + 2e17) == TimeUnit::kNs);
  // On a clock that starts at 0, frames in ns seem to be 50 s apart.
  CHECK(unit_of(whole * 1000) == TimeUnit::kNs);
  CHECK(unit_of((whole * 1000).to(torch::kInt64)) == TimeUnit::kNs);
  CHECK(unit_of(whole.to(torch::kInt64)) == TimeUnit::kUs);
  CHECK(unit_of(whole + 0.5) == TimeUnit::kS);
  // One frame per second, or one in ten minutes.
  const auto seconds = torch::tensor({1.7e9, 1.7e9 + 1, 1.7e9 + 2}, torch::kFloat64);
  CHECK(unit_of(seconds) == TimeUnit::kS);
  CHECK(unit_of((seconds - 1.7e9) * 600) == TimeUnit::kS);
  CHECK(unit_of(torch::tensor({5e6}, torch::kFloat64)) == TimeUnit::kS);
}

TEST_CASE("time unit: whole microseconds, of nanoseconds since 1970 too", "[events]") {
  const torch::Tensor times = torch::tensor(std::vector<int64_t>{1700000000123456789});
  CHECK(times_us(times, TimeUnit::kNs, "t")[0] == 1700000000123457);
  CHECK(times_us(torch::tensor({0.25}, torch::kFloat64), TimeUnit::kS, "t")[0] == 250000);
  CHECK_THROWS_AS(times_us(torch::tensor({INT64_MAX}), TimeUnit::kUs, "t"), jade::DataError);
  CHECK_THROWS_AS(times_us(torch::zeros({2, 2}), TimeUnit::kUs, "t"), jade::DataError);
  CHECK_THROWS_AS(us_per_unit(TimeUnit::kAuto), jade::ContractError);
}

TEST_CASE("time unit: beside frames, the unit of a camera's rate that covers them", "[events]") {
  const TimeWindow frames{0, 2000000};
  const auto unit = [&](double last, bool fraction, int64_t count) {
    return unit_beside_frames(0, last, fraction, count, frames);
  };
  CHECK(unit(2e6, false, 1000000) == TimeUnit::kUs);
  CHECK(unit(2e9, false, 1000000) == TimeUnit::kNs);
  CHECK(unit(2000, false, 1000000) == TimeUnit::kMs);
  CHECK(unit(2, true, 1000000) == TimeUnit::kS);
  CHECK(unit(2e6, true, 1000000) == TimeUnit::kUs);
  // 33 minutes of events with 2 s of frames, by their rate.
  CHECK(unit(2e9, false, 1000000000) == TimeUnit::kUs);
  CHECK(unit(2e9, false, 50) == TimeUnit::kUs);
}
