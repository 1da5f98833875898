// SPDX-License-Identifier: Apache-2.0
#include "jade/import/exposure_length.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "import/moving_pattern.h"
#include "jade/core/progress.h"

using namespace jade;

namespace {

/// Hand motion in front of a textured plane, 50 ms from frame to frame.
test::PatternRecording recorded(int64_t exposure_us) {
  set_progress_enabled(false);
  simulate::EventSensorOptions sensor;
  sensor.threshold_positive = 0.2, sensor.threshold_negative = 0.25;
  sensor.threshold_spread = 0.03;
  test::PatternMotion motion;
  motion.exposure_us = exposure_us, motion.gap_us = 50000 - exposure_us;
  motion.x_px = [](double t) { return 14 * std::sin(19 * t) + 5 * std::sin(41 * t + 1); };
  motion.y_px = [](double t) { return 9 * std::sin(23 * t + 2) + 4 * std::sin(37 * t); };
  return test::record_pattern(motion, sensor);
}

std::vector<import::StampedFrame> stamped(const test::PatternRecording& recording,
                                          recording::Stamp stamp) {
  std::vector<import::StampedFrame> frames;
  for (const data::Exposure& e : recording.exposures) {
    frames.push_back({e.blurry, stamp == recording::Stamp::kStart    ? e.t_start_us
                                : stamp == recording::Stamp::kMiddle ? e.t_mid_us()
                                                                     : e.t_end_us});
  }
  return frames;
}

}  // namespace

TEST_CASE("exposure length: found with the stamp, whatever it marks", "[import]") {
  for (const int64_t exposure_us : {18000, 40000}) {
    const test::PatternRecording recording = recorded(exposure_us);
    for (const auto stamp :
         {recording::Stamp::kStart, recording::Stamp::kMiddle, recording::Stamp::kEnd}) {
      const import::ExposureLength found = import::estimate_exposure_length(
          stamped(recording, stamp), recording.events, std::nullopt);
      CAPTURE(exposure_us, found.length_us, found.error_us, found.doubt);
      CHECK_FALSE(found.ambiguous());
      CHECK(double(found.length_us) == Approx(double(exposure_us)).epsilon(0.1));
      CHECK((found.stamp == stamp));
      CHECK(found.lengths_us.size() == found.losses.size());
    }
    const import::ExposureLength given = import::estimate_exposure_length(
        stamped(recording, recording::Stamp::kEnd), recording.events, recording::Stamp::kEnd);
    CHECK(double(given.length_us) == Approx(double(exposure_us)).epsilon(0.1));
  }
}

TEST_CASE("exposure length: the error covers the truth, also of short exposures", "[import]") {
  for (const int64_t exposure_us : {5000, 10000, 48000}) {
    const test::PatternRecording recording = recorded(exposure_us);
    const import::ExposureLength found = import::estimate_exposure_length(
        stamped(recording, recording::Stamp::kStart), recording.events, std::nullopt);
    CAPTURE(exposure_us, found.length_us, found.error_us, found.doubt);
    CHECK_FALSE(found.ambiguous());
    CHECK(std::abs(double(found.length_us - exposure_us)) < 3 * found.error_us);
    CHECK(found.error_us >= 500);
  }
}

TEST_CASE("exposure length: too little blur is named as such", "[import]") {
  const test::PatternRecording recording = recorded(1500);
  const import::ExposureLength found = import::estimate_exposure_length(
      stamped(recording, recording::Stamp::kStart), recording.events, std::nullopt);
  CHECK_THAT(found.doubt, Catch::Contains(" ms off; is there motion blur?"));
}

TEST_CASE("exposure length: in doubt where frames and events tell nothing of it", "[import]") {
  const test::PatternRecording recording = recorded(30000);
  auto frames = stamped(recording, recording::Stamp::kMiddle);
  CHECK(import::estimate_exposure_length(frames, {}, std::nullopt).ambiguous());
  CHECK(import::estimate_exposure_length({frames[0], frames[1]}, recording.events, std::nullopt)
            .ambiguous());
  torch::manual_seed(3);
  for (import::StampedFrame& frame : frames) frame.image = torch::rand_like(frame.image);
  CHECK(import::estimate_exposure_length(frames, recording.events, std::nullopt).ambiguous());
}
