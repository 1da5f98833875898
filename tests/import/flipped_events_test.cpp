// SPDX-License-Identifier: Apache-2.0
#include "jade/import/flipped_events.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "import/moving_pattern.h"
#include "jade/import/clock_offset.h"

using namespace jade;

TEST_CASE("flips: events with opposite axes or polarity are named, others are not", "[import]") {
  simulate::EventSensorOptions sensor;
  sensor.threshold_positive = 0.2, sensor.threshold_negative = 0.25;
  test::PatternMotion motion;
  motion.x_px = [](double t) { return 14 * std::sin(19 * t) + 5 * std::sin(41 * t + 1); };
  motion.y_px = [](double t) { return 9 * std::sin(23 * t + 2) + 4 * std::sin(37 * t); };
  const test::PatternRecording recording = test::record_pattern(motion, sensor);
  std::vector<data::Exposure> stamped = recording.exposures;
  for (data::Exposure& exposure : stamped) exposure.t_end_us = exposure.t_start_us;
  const events::EventStream& e = recording.events;
  const torch::Tensor x = 63 - e.x(), y = 47 - e.y();
  for (const auto& exposures : {recording.exposures, stamped}) {
    const auto said = [&](const torch::Tensor& columns, const torch::Tensor& rows) {
      const events::EventStream events(columns, rows, e.t_us(), e.polarity());
      const double correlation = import::estimate_clock_offset(exposures, events).correlation;
      return import::find_flip(exposures, events, correlation);
    };
    CHECK(said(e.x(), e.y()).empty());
    CHECK_THAT(said(e.x(), y), Catch::Contains("upside down") && Catch::EndsWith("y by 47 - y"));
    CHECK_THAT(said(x, e.y()), Catch::Contains("left to right") && Catch::EndsWith("x by 63 - x"));
    CHECK_THAT(said(x, y), Catch::EndsWith("x by 63 - x and y by 47 - y"));
    const events::EventStream reversed(e.x(), e.y(), e.t_us(), -e.polarity());
    CHECK_THAT(import::find_flip(exposures, reversed,
                                 import::estimate_clock_offset(exposures, reversed).correlation),
               Catch::Contains("reversed polarity"));
    torch::manual_seed(1);
    CHECK(said(torch::rand({e.size()}) * 63, torch::rand({e.size()}) * 47).empty());
  }
}

TEST_CASE("flips: exchanged and turned axes of a square sensor are named", "[import]") {
  simulate::EventSensorOptions sensor;
  sensor.threshold_positive = 0.2, sensor.threshold_negative = 0.25;
  test::PatternMotion motion;
  motion.width = motion.height = 48;
  motion.x_px = [](double t) { return 14 * std::sin(19 * t) + 5 * std::sin(41 * t + 1); };
  motion.y_px = [](double t) { return 9 * std::sin(23 * t + 2) + 4 * std::sin(37 * t); };
  const test::PatternRecording recording = test::record_pattern(motion, sensor);
  const events::EventStream& e = recording.events;
  const auto said = [&](const torch::Tensor& x, const torch::Tensor& y) {
    const events::EventStream events(x, y, e.t_us(), e.polarity());
    const auto clock = import::estimate_clock_offset(recording.exposures, events);
    return import::find_flip(recording.exposures, events, clock.correlation);
  };
  CHECK(said(e.x(), e.y()).empty());
  CHECK_THAT(said(e.y(), e.x()), Catch::EndsWith("exchange x and y"));
  CHECK_THAT(said(e.x(), 47 - e.y()), Catch::EndsWith("y by 47 - y"));
  // An event at the top lies at the right.
  CHECK_THAT(said(47 - e.y(), e.x()), Catch::Contains("turned by 90 degrees clockwise") &&
                                          Catch::EndsWith("replace x by y and y by 47 - x"));
  CHECK_THAT(said(e.y(), 47 - e.x()), Catch::Contains("turned by 90 degrees anticlockwise") &&
                                          Catch::EndsWith("replace x by 47 - y and y by x"));
  CHECK_THAT(said(47 - e.y(), 47 - e.x()), Catch::EndsWith("replace x by 47 - y and y by 47 - x"));
}
