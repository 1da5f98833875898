// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/sensor.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>

using namespace jade;
using namespace jade::simulate;

namespace {

world::SharpFrame flat(float value, int64_t size = 8) {
  world::SharpFrame frame;
  frame.resize(size, size);
  std::fill(frame.rgb.begin(), frame.rgb.end(), value);
  return frame;
}

double pixel(const torch::Tensor& image) { return image[0][2][3].item<double>(); }

}  // namespace

TEST_CASE("exposure: is the mean of its frames, each as long as it was seen", "[simulate]") {
  Exposing exposing({}, 8, 8);
  exposing.add(flat(0.2f), flat(0.4f), 1000);
  exposing.add(flat(0.4f), flat(0.8f), 3000);
  CHECK(pixel(exposing.mean()) == Approx((0.3 * 1000 + 0.6 * 3000) / 4000));
  CHECK(pixel(exposing.develop(1)) == Approx(std::round(0.525 * 255) / 255));
}

TEST_CASE("exposure: averages stored values or light, as told", "[simulate]") {
  ImageSensorOptions options;
  options.encoding = Encoding::kSrgb;
  Exposing stored(options, 8, 8);
  options.blur_space = Space::kLinear;
  Exposing light(options, 8, 8);
  for (Exposing* exposing : {&stored, &light}) {
    exposing->add(flat(0.1f), flat(0.1f), 500);
    exposing->add(flat(0.9f), flat(0.9f), 500);
  }
  CHECK(pixel(stored.mean()) == Approx(0.5));
  const float mean = 0.5f * (decode(0.1f, Encoding::kSrgb) + decode(0.9f, Encoding::kSrgb));
  CHECK(pixel(light.mean()) == Approx(encode(mean, Encoding::kSrgb)));
  CHECK(pixel(light.mean()) > 0.6);
}

TEST_CASE("encoding: light and stored values map onto each other", "[simulate]") {
  for (float v = 0; v <= 1; v += 0.05f) {
    CHECK(encode(decode(v, Encoding::kSrgb), Encoding::kSrgb) == Approx(v).margin(1e-5));
    CHECK(decode(v, Encoding::kLinear) == v);
  }
}

TEST_CASE("noise: photon and read noise have the variance asked for, by the seed", "[simulate]") {
  ImageSensorOptions options;
  options.full_well = 2000, options.read_noise = 0.01;
  Exposing exposing(options, 100, 100);
  exposing.add(flat(0.4f, 100), flat(0.4f, 100), 1000);
  const auto image = exposing.develop(3);
  const double variance = 0.4 / 2000 + 0.01 * 0.01 + 1.0 / (12 * 255 * 255);
  CHECK(image.mean().item<double>() == Approx(0.4).margin(4 * std::sqrt(variance / 30000)));
  CHECK(image.var().item<double>() == Approx(variance).epsilon(0.06));
  CHECK(image.equal(exposing.develop(3)));
  CHECK_FALSE(image.equal(exposing.develop(4)));
  const auto steps = image * 255;
  CHECK((steps - steps.round()).abs().max().item<double>() < 1e-3);
}

TEST_CASE("noise: of a few photons is Poisson's, with as many pixels that see none", "[simulate]") {
  ImageSensorOptions options;
  options.full_well = 10;
  Exposing exposing(options, 100, 100);
  exposing.add(flat(0.2f, 100), flat(0.2f, 100), 1000);
  const auto photons = (exposing.develop(3) * 10).round();
  CHECK(photons.mean().item<double>() == Approx(2).margin(4 * std::sqrt(2.0 / 30000)));
  CHECK(photons.var().item<double>() == Approx(2).epsilon(0.05));
  CHECK((photons == 0).to(torch::kFloat64).mean().item<double>() ==
        Approx(std::exp(-2.0)).epsilon(0.06));
}

TEST_CASE("exposure: a shorter one has less light and more photon noise, gain multiplies both",
          "[simulate]") {
  ImageSensorOptions options;
  Exposing clean(options, 8, 8);
  clean.add(flat(0.4f), flat(0.4f), 1000);
  CHECK(pixel(clean.develop(1, {0.25, 1})) == Approx(0.1).margin(0.002));
  CHECK(pixel(clean.develop(1, {0.25, 2})) == Approx(0.2).margin(0.002));
  CHECK(pixel(clean.develop(1, {1, 4})) == 1);
  options.full_well = 2000, options.read_noise = 0.01;
  Exposing noisy(options, 100, 100);
  noisy.add(flat(0.4f, 100), flat(0.4f, 100), 1000);
  const auto image = noisy.develop(3, {0.5, 2});
  CHECK(image.mean().item<double>() == Approx(0.4).margin(0.002));
  const double variance = 4 * (0.2 / 2000 + 0.01 * 0.01);
  CHECK(image.var().item<double>() == Approx(variance).epsilon(0.06));
}

TEST_CASE("exposure: the sensor's fixed pattern comes last, and in linear light", "[simulate]") {
  ImageSensorOptions options;
  options.pattern_pixels = 0.02;
  const FixedPattern pattern(options, 8, 8, 5);
  Exposing exposing(options, 8, 8);
  exposing.add(flat(0.4f), flat(0.4f), 1000);
  const auto image = exposing.develop(1, {0.5, 2}, &pattern);
  for (const int64_t c : {0, 1, 2}) {
    CHECK(image[c][2][3].item<double>() == Approx(pattern.apply(0.4, 19)).margin(0.002));
  }
}

TEST_CASE("event intensity: is the gray value of what the pixels see", "[simulate]") {
  world::SharpFrame frame = flat(0);
  const size_t plane = 64;
  for (size_t i = 0; i < plane; ++i) {
    frame.rgb[i] = 0.5f, frame.rgb[i + plane] = 0.25f, frame.rgb[i + 2 * plane] = 0.75f;
  }
  ImageSensorOptions image;
  EventSensorOptions events;
  std::vector<float> gray;
  event_intensity(frame, image, events, gray);
  CHECK(gray[5] == Approx(0.299 * 0.5 + 0.587 * 0.25 + 0.114 * 0.75));
  image.encoding = Encoding::kSrgb, events.space = Space::kLinear;
  event_intensity(frame, image, events, gray);
  CHECK(gray[5] ==
        Approx(0.299 * decode(0.5f, Encoding::kSrgb) + 0.587 * decode(0.25f, Encoding::kSrgb) +
               0.114 * decode(0.75f, Encoding::kSrgb)));
}

TEST_CASE("event intensity: behind a colour filter a pixel sees its channel alone", "[simulate]") {
  world::SharpFrame frame = flat(0);
  const size_t plane = 64;
  for (size_t i = 0; i < plane; ++i) {
    frame.rgb[i] = 0.5f, frame.rgb[i + plane] = 0.25f, frame.rgb[i + 2 * plane] = 0.75f;
  }
  ImageSensorOptions image;
  EventSensorOptions events;
  events.bayer = Bayer::kRggb;
  std::vector<float> seen;
  event_intensity(frame, image, events, seen);
  for (size_t row = 0; row < 8; row += 2) {
    CHECK(seen[8 * row] == 0.5f);
    CHECK(seen[8 * row + 1] == 0.25f);
    CHECK(seen[8 * row + 8] == 0.25f);
    CHECK(seen[8 * row + 9] == 0.75f);
  }
  image.encoding = Encoding::kSrgb, events.space = Space::kLinear;
  event_intensity(frame, image, events, seen);
  CHECK(seen[9] == Approx(decode(0.75f, Encoding::kSrgb)));
}
