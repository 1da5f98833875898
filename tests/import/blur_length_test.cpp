// SPDX-License-Identifier: Apache-2.0
#include "jade/import/blur_length.h"

#include "support/catch.h"

#include <cmath>

#include "import/moving_pattern.h"

using namespace jade;

namespace {

constexpr int64_t kWidth = 96, kHeight = 72;

simulate::EventSensorOptions blur_sensor() {
  simulate::EventSensorOptions sensor;
  sensor.threshold_spread = 0.03;
  sensor.shot_hz = 3;
  return sensor;
}

/// Blur estimated for one exposure of a pattern that moves along `x_px`, `y_px` (of seconds).
double found_blur(const std::function<double(double)>& x_px,
                  const std::function<double(double)>& y_px) {
  test::PatternMotion motion;
  motion.width = kWidth, motion.height = kHeight;
  motion.exposures = 1, motion.exposure_us = 50000;
  motion.x_px = x_px, motion.y_px = y_px;
  const auto recording = test::record_pattern(motion, blur_sensor());
  const auto& exposure = recording.exposures.at(0);
  return import::blur_px(recording.events, {exposure.t_start_us, exposure.t_end_us},
                         {kHeight, kWidth});
}

}  // namespace

TEST_CASE("blur length: even motions are measured to 20 %", "[import]") {
  for (const double truth : {4.0, 8.0, 16.0}) {
    const double speed = truth / 0.05;
    for (const double angle : {0.0, 2.5}) {
      const double found = found_blur([&](double t) { return speed * std::cos(angle) * t; },
                                      [&](double t) { return speed * std::sin(angle) * t; });
      CAPTURE(truth, angle, found);
      CHECK(std::abs(found - truth) < 0.2 * truth);
    }
  }
}

TEST_CASE("blur length: a static camera has none, for all its noise", "[import]") {
  CHECK(found_blur([](double) { return 0.0; }, [](double) { return 0.0; }) < 0.5);
}

TEST_CASE("blur length: patches that move differently are averaged", "[import]") {
  // The left half moves by 4 px, the right by 12.
  test::PatternMotion motion;
  motion.width = kWidth, motion.height = kHeight;
  motion.exposures = 1, motion.exposure_us = 50000;
  motion.y_px = [](double) { return 0.0; };
  motion.x_px = [](double t) { return 80 * t; };
  const auto slow = test::record_pattern(motion, blur_sensor());
  motion.x_px = [](double t) { return 240 * t; };
  const auto fast = test::record_pattern(motion, blur_sensor());
  const auto& window = slow.exposures.at(0);
  const auto blur = [&](const events::EventStream& events) {
    return import::blur_px(events, {window.t_start_us, window.t_end_us}, {kHeight, kWidth});
  };
  CHECK(blur(slow.events) == Approx(4).epsilon(0.2));
  CHECK(blur(fast.events) == Approx(12).epsilon(0.2));
  // One after the other in arrays, then in order of time.
  const torch::Tensor left = (slow.events.x() < 47.5f).nonzero().flatten();
  const torch::Tensor right = (fast.events.x() > 47.5f).nonzero().flatten();
  const auto both = [&](const torch::Tensor& a, const torch::Tensor& b) {
    return torch::cat({a.index_select(0, left), b.index_select(0, right)});
  };
  const torch::Tensor t = both(slow.events.t_us(), fast.events.t_us());
  const torch::Tensor order = t.argsort();
  const auto sorted = [&](const torch::Tensor& a, const torch::Tensor& b) {
    return both(a, b).index_select(0, order);
  };
  const events::EventStream mixed(
      sorted(slow.events.x(), fast.events.x()), sorted(slow.events.y(), fast.events.y()),
      t.index_select(0, order), sorted(slow.events.polarity(), fast.events.polarity()));
  const double found = blur(mixed);
  CHECK(found > 6);
  CHECK(found < 12);
}

TEST_CASE("blur length: no events, no time, no blur", "[import]") {
  CHECK(import::blur_px({}, {0, 1000}, {kHeight, kWidth}) == 0);
  CHECK(import::blur_px(events::EventStream::from_lists({1}, {1}, {5}, {1}), {5, 5},
                        {kHeight, kWidth}) == 0);
}
