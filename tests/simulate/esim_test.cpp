// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/esim.h"

#include "support/catch.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <functional>

#include "jade/core/error.h"

using namespace jade;
using namespace jade::simulate;

namespace {

constexpr double kEps = 1e-3;

EventSensorOptions clean(double positive, double negative) {
  EventSensorOptions options;
  options.threshold_positive = positive, options.threshold_negative = negative;
  return options;
}

// Intensity whose logarithm (with eps) is `log_value`.
float intensity(double log_value) { return static_cast<float>(std::exp(log_value) - kEps); }

/// One picture every `step_us` in which every pixel has log intensity curve(t in s).
events::EventStream watch(const EventSensorOptions& options, int64_t width, int64_t height,
                          int64_t duration_us, int64_t step_us,
                          const std::function<double(double)>& curve, uint64_t seed = 1) {
  EventSensor sensor(options, width, height, seed);
  std::vector<float> picture(static_cast<size_t>(width * height));
  for (int64_t t = 0; t <= duration_us; t += step_us) {
    std::fill(picture.begin(), picture.end(), intensity(curve(static_cast<double>(t) * 1e-6)));
    sensor.feed(picture, t);
  }
  return sensor.take();
}

bool same(const events::EventStream& a, const events::EventStream& b) {
  return a.size() == b.size() && a.x().equal(b.x()) && a.y().equal(b.y()) &&
         a.t_us().equal(b.t_us()) && a.polarity().equal(b.polarity());
}

}  // namespace

TEST_CASE("esim: a linear ramp crosses at equal steps in time", "[simulate]") {
  const double from = -2.0, slope = 1.5, theta = 0.2;  // per second
  const auto events =
      watch(clean(theta, 0.3), 1, 1, 1000000, 50000, [&](double t) { return from + slope * t; });
  REQUIRE(events.size() == static_cast<int64_t>(std::floor(slope / theta)));
  for (int64_t i = 0; i < events.size(); ++i) {
    const double expected = 1e6 * theta * static_cast<double>(i + 1) / slope;
    CHECK(std::abs(events.t_us()[i].item<int64_t>() - expected) <= 2);
    CHECK(events.polarity()[i].item<int8_t>() == 1);
  }
}

TEST_CASE("esim: a falling ramp uses the negative threshold", "[simulate]") {
  const auto events =
      watch(clean(0.2, 0.3), 1, 1, 1000000, 50000, [](double t) { return -0.5 - 1.4 * t; });
  REQUIRE(events.size() == 4);
  CHECK(std::abs(events.t_us()[0].item<int64_t>() - 1e6 * 0.3 / 1.4) <= 2);
  CHECK(events.polarity().eq(-1).all().item<bool>());
}

TEST_CASE("esim: a sinusoid gives the events of its level crossings", "[simulate]") {
  const double amplitude = 0.95, theta = 0.2;
  const auto curve = [&](double t) { return -1.5 + amplitude * std::sin(6.283185307 * t); };
  const auto events = watch(clean(theta, theta), 1, 1, 980000, 200, curve);
  std::vector<double> levels;
  double reference = 0;
  for (double t = 0; t < 0.98; t += 1e-6) {
    const double value = amplitude * std::sin(6.283185307 * t);
    if (value >= reference + theta) levels.push_back(t * 1e6), reference += theta;
    if (value <= reference - theta) levels.push_back(-t * 1e6), reference -= theta;
  }
  REQUIRE(events.size() == static_cast<int64_t>(levels.size()));
  for (int64_t i = 0; i < events.size(); ++i) {
    const double expected = levels[static_cast<size_t>(i)];
    CHECK(std::abs(events.t_us()[i].item<int64_t>() - std::abs(expected)) <= 20);
    CHECK(events.polarity()[i].item<int8_t>() == (expected > 0 ? 1 : -1));
  }
}

TEST_CASE("esim: the refractory period drops events and moves the reference on", "[simulate]") {
  auto options = clean(0.1, 0.1);
  const auto curve = [](double t) { return -3 + 2 * t; };  // an event every 50 ms
  const auto all = watch(options, 1, 1, 1000000, 10000, curve);
  options.refractory_us = 75000;
  const auto fewer = watch(options, 1, 1, 1000000, 10000, curve);
  REQUIRE(all.size() >= 19);
  // Every second event remains, at the same time.
  REQUIRE(fewer.size() == (all.size() + 1) / 2);
  for (int64_t i = 0; i < fewer.size(); ++i) {
    CHECK(fewer.t_us()[i].item<int64_t>() == all.t_us()[2 * i].item<int64_t>());
  }
}

TEST_CASE("esim: thresholds spread over pixels as asked and stay above 0.01", "[simulate]") {
  auto options = clean(0.25, 0.2);
  options.threshold_spread = 0.03;
  const EventSensor sensor(options, 100, 100, 3);
  double sum = 0, square = 0, product = 0, off = 0;
  for (int64_t i = 0; i < 10000; ++i) {
    const double p = sensor.threshold_positive(i) - 0.25, n = sensor.threshold_negative(i) - 0.2;
    sum += p, square += p * p, product += p * n, off += n;
  }
  CHECK(std::abs(sum / 1e4) < 0.0012);  // four standard errors
  CHECK(std::abs(off / 1e4) < 0.0012);
  CHECK(std::sqrt(square / 1e4) == Approx(0.03).epsilon(0.04));
  CHECK(std::abs(product / 1e4) < 4 * 0.03 * 0.03 / 100);
  options.threshold_spread = 1;
  const EventSensor wild(options, 50, 50, 3);
  for (int64_t i = 0; i < 2500; ++i) {
    if (wild.threshold_positive(i) < 0.0099) FAIL("a threshold of " << wild.threshold_positive(i));
  }
}

TEST_CASE("esim: noise comes at its rates and changes nothing where it is off", "[simulate]") {
  const auto still = [](double) { return std::log(0.4); };
  CHECK(watch(clean(0.2, 0.2), 50, 50, 2000000, 10000, still).empty());
  SECTION("leak: ON events at its rate, one after the other") {
    auto options = clean(0.2, 0.2);
    options.leak_hz = 5;
    const auto events = watch(options, 4, 4, 2000000, 10000, still);
    CHECK(events.size() == Approx(16 * 10).margin(16));
    CHECK(events.polarity().eq(1).all().item<bool>());
  }
  SECTION("shot noise: both polarities, fewer where it is bright") {
    auto options = clean(0.2, 0.2);
    options.shot_hz = 10;
    const double expected = 2500 * 2 * 10 * (1 - 0.75 * (0.4 - kEps));
    const auto events = watch(options, 50, 50, 2000000, 10000, still);
    CHECK(std::abs(events.size() - expected) < 5 * std::sqrt(expected));
    const double balance = events.polarity().to(torch::kFloat64).sum().item<double>();
    CHECK(std::abs(balance) < 5 * std::sqrt(expected));
  }
  SECTION("hot pixels: a few pixels fire, ON") {
    auto options = clean(0.2, 0.2);
    options.hot_fraction = 0.02, options.hot_hz = 50;
    const auto events = watch(options, 50, 50, 2000000, 10000, still);
    CHECK(events.size() / 100.0 == Approx(50).margin(30));
    CHECK(events.polarity().eq(1).all().item<bool>());
  }
}

TEST_CASE("esim: a narrow bandwidth delays and thins out events", "[simulate]") {
  auto options = clean(0.1, 0.1);
  const auto flicker = [](double t) { return -1 + 0.6 * std::sin(6.283185307 * 100 * t); };
  const auto wide = watch(options, 1, 1, 100000, 100, flicker);
  options.cutoff_hz = 20;
  const auto narrow = watch(options, 1, 1, 100000, 100, flicker);
  CHECK(wide.size() > 150);
  CHECK(narrow.size() < wide.size() / 3);
  // A step: the filtered value reaches half of it after ln 2 / (2π f).
  options.cutoff_hz = 50, options.threshold_positive = 0.5;
  const double level = std::log(0.8 + kEps), before = level - 1.0;
  const auto step =
      watch(options, 1, 1, 200000, 100, [&](double t) { return t < 0.01 ? before : level; });
  REQUIRE(step.size() >= 1);
  const double half_us = 1e6 * std::log(2.0) / (6.283185307 * 50 * 0.8);
  CHECK(step.t_us()[0].item<int64_t>() == Approx(10000 + half_us).margin(150));
}

TEST_CASE("esim: the seed decides, the number of threads does not", "[simulate]") {
  EventSensorOptions options = clean(0.2, 0.25);
  options.threshold_spread = 0.05, options.shot_hz = 20, options.leak_hz = 2;
  options.hot_fraction = 0.01, options.hot_hz = 30, options.cutoff_hz = 300;
  options.refractory_us = 500;
  const auto wave = [](double t) { return -1 + 0.7 * std::sin(30 * t); };
  const int threads = at::get_num_threads();
  const auto run = [&](int count, uint64_t seed) {
    at::set_num_threads(count);
    auto events = watch(options, 40, 37, 300000, 3000, wave, seed);
    at::set_num_threads(threads);
    return events;
  };
  const auto first = run(1, 5);
  CHECK(first.size() > 10000);
  CHECK(same(first, run(2, 5)));
  CHECK(same(first, run(4, 5)));
  CHECK_FALSE(same(first, run(1, 6)));
  const auto t = first.t_us();
  CHECK((t.slice(0, 1) >= t.slice(0, 0, -1)).all().item<bool>());
}

TEST_CASE("esim: events are late by what is asked for, the more so in the dark", "[simulate]") {
  const double theta = 0.2;
  const auto ramp = [](double from) { return [from](double t) { return from + 1.5 * t; }; };
  EventSensorOptions options = clean(theta, theta);
  const auto bright = watch(options, 1, 1, 400000, 1000, ramp(-0.9));
  const auto dark = watch(options, 1, 1, 400000, 1000, ramp(-4));
  options.latency_us = 700, options.dark_latency_us = 5000;
  const auto late_bright = watch(options, 1, 1, 400000, 1000, ramp(-0.9));
  const auto late_dark = watch(options, 1, 1, 400000, 1000, ramp(-4));
  REQUIRE((bright.size() == 2 && late_bright.size() == 2 && late_dark.size() == 2));
  for (int64_t i = 0; i < 2; ++i) {
    const auto late = [&](const auto& a, const auto& b) {
      return static_cast<double>((a.t_us()[i] - b.t_us()[i]).template item<int64_t>());
    };
    CHECK(late(late_dark, dark) == 5700);
    const double level = std::exp(-0.9 + theta * static_cast<double>(i + 1));
    CHECK(late(late_bright, bright) == Approx(700 + 5000 * 0.1 / level).margin(5));
  }
}

TEST_CASE("esim: late events are in order of time all the same", "[simulate]") {
  EventSensorOptions options = clean(0.1, 0.1);
  options.dark_latency_us = 9000;
  const auto events =
      watch(options, 6, 5, 300000, 1000, [](double t) { return -1.5 + 1.4 * std::sin(40 * t); });
  REQUIRE(events.size() > 1000);
  CHECK((events.t_us().slice(0, 1) >= events.t_us().slice(0, 0, -1)).all().item<bool>());
}

TEST_CASE("esim: in a burst every pixel fires at one instant", "[simulate]") {
  EventSensorOptions options = clean(0.3, 0.3);
  options.burst_hz = 20;
  const auto events = watch(options, 12, 10, 1000000, 10000, [](double) { return -1.0; });
  REQUIRE(events.size() > 0);
  CHECK(events.size() % 120 == 0);
  const int64_t bursts = events.size() / 120;
  CHECK((bursts > 8 && bursts < 35));
  for (int64_t i = 0; i < bursts; ++i) {
    const auto t = events.t_us().slice(0, 120 * i, 120 * (i + 1));
    CHECK((t == t[0]).all().item<bool>());
    const auto on = (events.polarity().slice(0, 120 * i, 120 * (i + 1)) > 0).sum();
    CHECK((on.item<int64_t>() > 30 && on.item<int64_t>() < 90));
  }
}

TEST_CASE("esim: after a burst a pixel starts afresh from what it sees", "[simulate]") {
  EventSensorOptions options = clean(0.3, 0.3);
  const auto ramp = [](double t) { return -2 + t; };
  const auto alone = watch(options, 1, 1, 1000000, 10000, ramp);
  options.burst_hz = 3;
  const auto burst = watch(options, 1, 1, 1000000, 10000, ramp);
  REQUIRE(alone.size() == 3);
  CHECK_FALSE(burst.t_us().equal(alone.t_us()));
  const auto t = burst.t_us().to(torch::kFloat64) * 1e-6;
  // No two of its steps are closer than a threshold, unless one of them is a burst.
  const auto steps = (t.slice(0, 1) - t.slice(0, 0, -1) >= 0.2999).sum().item<int64_t>();
  CHECK(steps <= 3);
  CHECK(burst.size() > steps);
}

TEST_CASE("esim: dead columns send nothing, the others what they sent", "[simulate]") {
  EventSensorOptions options = clean(0.2, 0.2);
  const auto wave = [](double t) { return -1 + 0.7 * std::sin(30 * t); };
  const auto whole = watch(options, 10, 4, 200000, 2000, wave);
  options.dead_columns = 3;
  const auto events = watch(options, 10, 4, 200000, 2000, wave);
  const auto columns = std::get<0>(at::_unique(events.x()));
  CHECK(columns.numel() == 7);
  CHECK(10 * events.size() == 7 * whole.size());
}

TEST_CASE("esim: wrong pictures and times that do not increase are refused", "[simulate]") {
  EventSensor sensor(clean(0.2, 0.2), 4, 4, 0);
  sensor.feed(std::vector<float>(16, 0.5f), 10);
  CHECK_THROWS_AS(sensor.feed(std::vector<float>(15, 0.5f), 20), ContractError);
  CHECK_THROWS_AS(sensor.feed(std::vector<float>(16, 0.5f), 10), ContractError);
}
