// SPDX-License-Identifier: Apache-2.0
#include "jade/import/frame_gains.h"

#include "support/catch.h"

#include <cmath>

#include "import/moving_pattern.h"

using namespace jade;

namespace {

test::PatternRecording hand_recording(int64_t exposures) {
  simulate::EventSensorOptions sensor;
  sensor.threshold_positive = 0.2, sensor.threshold_negative = 0.25;
  sensor.threshold_spread = 0.03;
  test::PatternMotion motion;
  motion.exposures = exposures;
  motion.x_px = [](double t) { return 14 * std::sin(19 * t) + 5 * std::sin(41 * t + 1); };
  motion.y_px = [](double t) { return 9 * std::sin(23 * t + 2) + 4 * std::sin(37 * t); };
  return test::record_pattern(motion, sensor);
}

}  // namespace

TEST_CASE("gains: found where the camera adjusts itself, and not elsewhere", "[import]") {
  test::PatternRecording recording = hand_recording(8);
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

TEST_CASE("gains: a single odd frame has its own and leaves the others alone", "[import]") {
  torch::manual_seed(2);
  const test::PatternRecording recording = hand_recording(8);
  REQUIRE(import::estimate_frame_gains(recording.exposures, recording.events).empty());
  for (const size_t odd : {size_t(0), size_t(4), size_t(7)}) {
    auto exposures = recording.exposures;
    const torch::Tensor noise = 0.01 * torch::randn({1, 48, 64});
    exposures[odd].blurry = (0.1 * exposures[odd].blurry + noise).clamp(0, 1);
    const auto gains = import::estimate_frame_gains(exposures, recording.events);
    REQUIRE(gains.size() == 8);
    for (size_t i = 0; i < 8; ++i) {
      CAPTURE(odd, i, gains[i]);
      CHECK((i == odd ? gains[i] < 0.5 : gains[i] == 1));
    }
  }
}
