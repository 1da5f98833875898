// SPDX-License-Identifier: Apache-2.0
#include "jade/import/frame_gains.h"

#include "support/catch.h"

#include <cmath>

#include "import/moving_pattern.h"

using namespace jade;

TEST_CASE("gains: found where the camera adjusts itself, and not elsewhere", "[import]") {
  simulate::EventSensorOptions sensor;
  sensor.threshold_positive = 0.2, sensor.threshold_negative = 0.25;
  sensor.threshold_spread = 0.03;
  test::PatternMotion motion;
  motion.x_px = [](double t) { return 14 * std::sin(19 * t) + 5 * std::sin(41 * t + 1); };
  motion.y_px = [](double t) { return 9 * std::sin(23 * t + 2) + 4 * std::sin(37 * t); };
  test::PatternRecording recording = test::record_pattern(motion, sensor);
  CHECK(import::estimate_frame_gains(recording.exposures, recording.events).empty());
  const double truth[] = {1, 0.8, 0.8, 0.9, 1.1, 1.1, 1, 1};
  double mean = 0;
  for (size_t i = 0; i < 8; ++i) {
    recording.exposures[i].blurry = recording.exposures[i].blurry * truth[i];
    mean += std::log(truth[i]) / 8;
  }
  const std::vector<double> gains =
      import::estimate_frame_gains(recording.exposures, recording.events);
  REQUIRE(gains.size() == 8);
  for (size_t i = 0; i + 1 < 8; ++i) {
    CAPTURE(i, gains[i], gains[i + 1]);
    CHECK(gains[i + 1] / gains[i] == Approx(truth[i + 1] / truth[i]).epsilon(0.07));
  }
  CHECK(import::estimate_frame_gains({}, recording.events).empty());
  CHECK(import::estimate_frame_gains(recording.exposures, {}).empty());
}
