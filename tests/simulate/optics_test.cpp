// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/optics.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>

#include "jade/simulate/sensor.h"

using namespace jade;
using namespace jade::simulate;

namespace {

constexpr int64_t kLensWidth = 40, kLensHeight = 30;

world::SharpFrame gray_picture(float value) {
  world::SharpFrame frame;
  frame.resize(kLensWidth, kLensHeight);
  std::fill(frame.rgb.begin(), frame.rgb.end(), value);
  std::fill(frame.depth.begin(), frame.depth.end(), 3.0f);
  return frame;
}

world::SharpFrame lit(const SimulateOptions& options, double t_us = 0) {
  const Optics optics(options, kLensWidth, kLensHeight, 5);
  REQUIRE(optics.changes());
  world::SharpFrame result;
  optics.light(gray_picture(0.5f), t_us, result);
  CHECK(result.depth == gray_picture(0.5f).depth);
  return result;
}

float middle_of(const world::SharpFrame& frame) {
  return frame.rgb[kLensHeight / 2 * kLensWidth + kLensWidth / 2];
}

}  // namespace

TEST_CASE("optics: nothing is changed unless asked for", "[simulate]") {
  CHECK_FALSE(Optics({}, kLensWidth, kLensHeight, 5).changes());
}

TEST_CASE("optics: a lens that vignettes loses light in its corners", "[simulate]") {
  SimulateOptions options;
  options.optics.vignetting = 0.6;
  const auto frame = lit(options);
  CHECK(middle_of(frame) == Approx(0.5).epsilon(0.01));
  CHECK(frame.rgb.front() == Approx(0.5 * 0.4).epsilon(0.1));
  CHECK(frame.rgb.back() == Approx(frame.rgb.front()));
}

TEST_CASE("optics: dust is dark, the same in every picture, and leaves the rest", "[simulate]") {
  SimulateOptions options;
  options.optics.dust = 3, options.optics.dust_radius_px = 2;
  const auto frame = lit(options);
  const auto darkened = [](float v) { return v < 0.45f; };
  const auto count = std::count_if(frame.rgb.begin(), frame.rgb.end(), darkened);
  CHECK((count > 9 && count < kLensWidth * kLensHeight / 2));
  CHECK(frame.rgb == lit(options, 5000).rgb);
}

TEST_CASE("optics: lamps on the mains flicker about the mean", "[simulate]") {
  SimulateOptions options;
  options.light.flicker = 0.3, options.light.flicker_hz = 100;
  CHECK(middle_of(lit(options, 0)) == Approx(0.65));
  CHECK(middle_of(lit(options, 5000)) == Approx(0.35));
  CHECK(middle_of(lit(options, 10000)) == Approx(0.65));
  CHECK(Optics(options, kLensWidth, kLensHeight, 5).flicker_step_us() <= 1000);
}

TEST_CASE("optics: brightness multiplies light, not stored values", "[simulate]") {
  SimulateOptions options;
  options.light.brightness = 0.25;
  CHECK(middle_of(lit(options)) == Approx(0.125));
  options.image.encoding = Encoding::kSrgb;
  const float expected = encode(0.25f * decode(0.5f, Encoding::kSrgb), Encoding::kSrgb);
  CHECK(middle_of(lit(options)) == Approx(expected));
  world::SharpFrame scene = gray_picture(0.5f);
  options.optics.vignetting = 0.9;
  Optics(options, kLensWidth, kLensHeight, 5).brighten(scene);
  CHECK(scene.rgb.front() == Approx(expected));
}

TEST_CASE("optics: between two pictures values run straight", "[simulate]") {
  world::SharpFrame mixed;
  mix(gray_picture(0.2f), gray_picture(0.6f), 0.25f, mixed);
  CHECK(mixed.rgb[7] == Approx(0.3));
}
