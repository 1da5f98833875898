// SPDX-License-Identifier: Apache-2.0
#include "jade/import/clock_offset.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "import/moving_pattern.h"
#include "jade/core/error.h"
#include "support/naming.h"

using namespace jade;

namespace {

simulate::EventSensorOptions noisy_sensor() {
  simulate::EventSensorOptions sensor;
  sensor.threshold_positive = 0.2, sensor.threshold_negative = 0.25;
  sensor.threshold_spread = 0.03;
  sensor.shot_hz = 2;
  sensor.refractory_us = 100;
  return sensor;
}

/// Hand motion: two sinusoids per axis, some 300 px/s.
test::PatternMotion by_hand() {
  test::PatternMotion motion;
  motion.x_px = [](double t) { return 14 * std::sin(19 * t) + 5 * std::sin(41 * t + 1); };
  motion.y_px = [](double t) { return 9 * std::sin(23 * t + 2) + 4 * std::sin(37 * t); };
  return motion;
}

test::PatternRecording shifted(test::PatternRecording recording, int64_t offset_us) {
  const auto& e = recording.events;
  recording.events = events::EventStream(e.x(), e.y(), e.t_us() + offset_us, e.polarity());
  return recording;
}

}  // namespace

TEST_CASE("clock offset: known offsets are found to two milliseconds", "[import]") {
  const auto recording = test::record_pattern(by_hand(), noisy_sensor());
  REQUIRE(recording.exposures.size() == 8);
  for (const int64_t truth_us : {-20000, 0, 13000}) {
    const auto moved = shifted(recording, truth_us);
    const auto found = import::estimate_clock_offset(moved.exposures, moved.events);
    CAPTURE(found.offset_us, found.error_us, found.correlation, found.second, found.doubt);
    CHECK_FALSE(found.ambiguous());
    CHECK(std::abs(found.offset_us - double(truth_us)) < 2000);
    CHECK(found.error_us < 1000);
    CHECK(found.correlation > 0.6);
    CHECK(found.curve.size() == 101);
  }
}

TEST_CASE("clock offset: the error covers the truth where pixels rarely fire", "[import]") {
  for (const double threshold : {0.15, 0.4, 0.7}) {
    simulate::EventSensorOptions sensor = noisy_sensor();
    sensor.threshold_positive = sensor.threshold_negative = threshold;
    sensor.latency_us = 400;
    const auto recording = test::record_pattern(by_hand(), sensor);
    const auto found = import::estimate_clock_offset(recording.exposures, recording.events);
    CAPTURE(threshold, found.offset_us, found.error_us, found.scatter_us, found.doubt);
    CHECK((found.ambiguous() || std::abs(found.offset_us) < 3 * found.error_us));
    CHECK(found.error_us > found.scatter_us);
  }
}

TEST_CASE("clock offset: exposures that overlap a little are neighbours", "[import]") {
  auto motion = by_hand();
  motion.gap_us = 500;
  auto recording = test::record_pattern(motion, noisy_sensor());
  for (auto& exposure : recording.exposures) exposure.t_end_us += 507;
  const auto found = import::estimate_clock_offset(recording.exposures, recording.events);
  CHECK(found.pairs == 7);
  CHECK_FALSE(found.ambiguous());
  CHECK(std::abs(found.offset_us) < 2000);
}

TEST_CASE("clock offset: a static camera is inconclusive", "[import]") {
  auto motion = by_hand();
  motion.x_px = motion.y_px = [](double) { return 0.0; };
  auto recording = test::record_pattern(motion, noisy_sensor());
  torch::manual_seed(1);
  for (auto& exposure : recording.exposures) {
    exposure.blurry = (exposure.blurry + 0.01 * torch::randn({48, 64})).contiguous();
  }
  const auto found = import::estimate_clock_offset(recording.exposures, recording.events);
  CHECK_THAT(found.doubt, Catch::Contains("stand still"));
}

TEST_CASE("clock offset: beyond the reach, and without events, there is doubt", "[import]") {
  const auto recording = test::record_pattern(by_hand(), noisy_sensor());
  CHECK(import::estimate_clock_offset(recording.exposures, {}).ambiguous());
  CHECK(import::estimate_clock_offset({}, recording.events).ambiguous());
  const auto late = shifted(recording, 70000);
  CHECK(import::estimate_clock_offset(late.exposures, late.events).ambiguous());
  const auto far = shifted(recording, 60000000);
  CHECK_THAT(import::estimate_clock_offset(far.exposures, far.events).doubt,
             test::naming("overlap"));
  CHECK_THROWS_AS(import::estimate_clock_offset(late.exposures, late.events, {50, 0}),
                  ContractError);
}

TEST_CASE("clock offset: frames that are too dark are not taken for missing events", "[import]") {
  test::PatternRecording dark = test::record_pattern(by_hand(), noisy_sensor());
  for (data::Exposure& exposure : dark.exposures) exposure.blurry = exposure.blurry * 0.01;
  CHECK_THAT(import::estimate_clock_offset(dark.exposures, dark.events).doubt,
             Catch::Contains("too dark"));
}

TEST_CASE("clock offset: a periodic motion has two answers", "[import]") {
  auto motion = by_hand();
  // Oscillates at 50 Hz: after 20 ms everything repeats.
  motion.x_px = [](double t) { return 6 * std::sin(2 * M_PI * 50 * t); };
  motion.y_px = [](double) { return 0.0; };
  motion.exposure_us = 4000, motion.gap_us = 27000;
  const auto recording = test::record_pattern(motion, noisy_sensor());
  CHECK(import::estimate_clock_offset(recording.exposures, recording.events).ambiguous());
}

TEST_CASE("clock drift: another rate of the events is found, a constant offset is none",
          "[import]") {
  auto motion = by_hand();
  motion.exposures = 20;
  const auto recording = test::record_pattern(motion, noisy_sensor());
  const auto scaled = [&](double rate, int64_t offset_us) {
    const auto& e = recording.events;
    const torch::Tensor t = (e.t_us().to(torch::kFloat64) * rate).round().to(torch::kInt64);
    return import::estimate_clock_drift(
        recording.exposures, events::EventStream(e.x(), e.y(), t + offset_us, e.polarity()));
  };
  for (const double rate : {1.02, 0.98}) {
    const import::ClockDrift drift = scaled(rate, -3000);
    CAPTURE(drift.begin_us, drift.end_us, drift.rate);
    CHECK(drift.found);
    CHECK(drift.rate == Approx(rate - 1).margin(0.004));
    CHECK(std::abs(drift.end_us - drift.begin_us) > 10000);
  }
  CHECK_FALSE(scaled(1, 0).found);
  CHECK_FALSE(scaled(1, 13000).found);
  CHECK_FALSE(import::estimate_clock_drift({}, {}).found);
}
