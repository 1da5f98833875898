// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/auto_exposure.h"

#include "support/catch.h"

#include <algorithm>

#include "support/drifting_pattern.h"

using namespace jade;
using namespace jade::simulate;

namespace {

/// Gets brighter by steps of 100 ms.
class BrighteningSteps : public test::DriftingPattern {
 public:
  explicit BrighteningSteps(std::vector<float> values)
      : DriftingPattern(12, 9, 0, 1000), values_(std::move(values)) {}
  void frame(int64_t t_us, int samples, world::SharpFrame& frame) const override {
    DriftingPattern::frame(t_us, samples, frame);
    std::fill(frame.rgb.begin(), frame.rgb.end(), values_.at(static_cast<size_t>(t_us / 100000)));
  }

 private:
  std::vector<float> values_;
};

SimulateOptions metering(int64_t exposures) {
  SimulateOptions options;
  options.exposures = exposures, options.exposure_ms = 80, options.gap_ms = 20;
  options.test_views = options.seen_test_views = 0;
  options.image.auto_exposure = 0.4;
  return options;
}

}  // namespace

TEST_CASE("auto-exposure: each frame is taken as the one before asks for", "[simulate]") {
  const BrighteningSteps footage({0.4f, 0.8f, 0.1f, 0.2f, 0.01f, 0.01f});
  const SimulateOptions options = metering(6);
  const auto settings = exposure_settings(options, footage, make_timeline(options));
  REQUIRE(settings.size() == 6);
  const double time[] = {1, 1, 0.5, 1, 1, 1}, gain[] = {1, 1, 1, 4, 2, 8};
  for (size_t i = 0; i < 6; ++i) {
    CHECK(settings[i].time == Approx(time[i]));
    CHECK(settings[i].gain == Approx(gain[i]));
    CHECK(settings[i].brightness() == Approx(time[i] * gain[i]));
  }
}

TEST_CASE("auto-exposure: sees the scene's brightness, and is off by default", "[simulate]") {
  const BrighteningSteps footage({0.4f, 0.4f});
  SimulateOptions options = metering(2);
  options.light.brightness = 2;
  CHECK(exposure_settings(options, footage, make_timeline(options))[1].time == Approx(0.5));
  options.image.auto_exposure = 0;
  CHECK(exposure_settings(options, footage, make_timeline(options))[1].brightness() == 1);
}

TEST_CASE("auto-exposure: shorter exposures keep their middles", "[simulate]") {
  const SimulateOptions options = metering(3);
  const Timeline before = make_timeline(options);
  Timeline after = before;
  shorten({{1, 1}, {0.25, 1}, {0.5, 1}}, after);
  const double time[] = {1, 0.25, 0.5};
  for (size_t i = 0; i < 3; ++i) {
    CHECK(after.exposures[i].mid_us() == before.exposures[i].mid_us());
    CHECK(after.exposures[i].end_us - after.exposures[i].begin_us ==
          static_cast<int64_t>(80000 * time[i]));
  }
}
