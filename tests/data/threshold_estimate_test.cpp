// SPDX-License-Identifier: Apache-2.0
#include "jade/data/threshold_estimate.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"

namespace jade::data {
namespace {

constexpr int64_t kSize = 48;

/// Brightness of a pattern that slides over the sensor, in (0.1, 0.9).
double brightness(int64_t x, int64_t y, double t_us) {
  const double u = 0.35 * (double(x) - 6e-5 * t_us);
  return 0.5 + 0.25 * std::sin(u) + 0.15 * std::sin(0.6 * u + 0.5 * double(y));
}

/// Frames and events of that pattern: an event at each crossing of a threshold.
/// @param spread  standard deviation of both thresholds from pixel to pixel
/// @param gap_us  between exposures of 80 ms
Dataset sliding_pattern(const events::Thresholds& mean, double spread, double log_offset,
                        int64_t gap_us = 40000) {
  struct Event {
    float x, y;
    int64_t t_us;
    int8_t polarity;
  };
  std::vector<Event> events;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  constexpr int64_t kStep = 250;
  constexpr int64_t kEnd = 1100000;
  for (int64_t y = 0; y < kSize; ++y) {
    for (int64_t x = 0; x < kSize; ++x) {
      double reference = std::log(brightness(x, y, 0) + log_offset);
      const double positive = std::max(0.02, mean.positive + spread * normal(random));
      const double negative = std::max(0.02, mean.negative + spread * normal(random));
      for (int64_t t = kStep; t <= kEnd; t += kStep) {
        const double now = std::log(brightness(x, y, double(t)) + log_offset);
        for (; now - reference >= positive; reference += positive) {
          events.push_back({float(x), float(y), t, 1});
        }
        for (; reference - now >= negative; reference -= negative) {
          events.push_back({float(x), float(y), t, -1});
        }
      }
    }
  }
  std::stable_sort(events.begin(), events.end(),
                   [](const Event& a, const Event& b) { return a.t_us < b.t_us; });
  std::vector<float> xs, ys;
  std::vector<int64_t> ts;
  std::vector<int8_t> ps;
  for (const Event& event : events) {
    xs.push_back(event.x);
    ys.push_back(event.y);
    ts.push_back(event.t_us);
    ps.push_back(event.polarity);
  }
  Dataset data;
  data.events = events::EventStream::from_lists(xs, ys, ts, ps);
  for (int64_t i = 0; i < 9; ++i) {
    Exposure exposure;
    exposure.t_start_us = 10000 + (80000 + gap_us) * i;
    exposure.t_end_us = exposure.t_start_us + 80000;
    exposure.camera = geometry::Intrinsics::centred(50, kSize, kSize);
    torch::Tensor frame = torch::zeros({kSize, kSize});
    for (int64_t k = 0; k < 9; ++k) {
      for (int64_t y = 0; y < kSize; ++y) {
        for (int64_t x = 0; x < kSize; ++x) {
          frame.data_ptr<float>()[y * kSize + x] +=
              float(brightness(x, y, double(exposure.t_start_us + 10000 * k)) / 9);
        }
      }
    }
    exposure.blurry = frame.expand({3, -1, -1}).contiguous();
    exposure.events = data.events.slice(exposure.t_start_us, exposure.t_end_us);
    data.train.push_back(std::move(exposure));
  }
  return data;
}

/// Relative error of the thresholds, the larger of the two.
double error_of(const ThresholdEstimate& estimate, double positive, double negative) {
  return std::max(std::abs(estimate.thresholds.positive / positive - 1),
                  std::abs(estimate.thresholds.negative / negative - 1));
}

ThresholdEstimate estimate_of(const Dataset& data, double log_offset) {
  return estimate_thresholds(data.train, data.events, log_offset);
}

TEST_CASE("thresholds: both are found in ideal events", "[data]") {
  const ThresholdEstimate estimate = estimate_of(sliding_pattern({0.25, 0.18}, 0, 0), 0);
  REQUIRE(estimate.found);
  CHECK(error_of(estimate, 0.25, 0.18) < 0.1);
  CHECK(estimate.unexplained < 0.2);
}

TEST_CASE("thresholds: a sensor with an offset is read with that offset", "[data]") {
  const ThresholdEstimate estimate = estimate_of(sliding_pattern({0.15, 0.15}, 0, 0.1), 0.1);
  REQUIRE(estimate.found);
  CHECK(error_of(estimate, 0.15, 0.15) < 0.1);
}

TEST_CASE("thresholds: their spread from pixel to pixel pulls them nowhere", "[data]") {
  // A fit of one pair of thresholds for all pixels is too low by a third.
  const ThresholdEstimate estimate = estimate_of(sliding_pattern({0.1, 0.12}, 0.03, 0), 0);
  REQUIRE(estimate.found);
  CHECK(error_of(estimate, 0.1, 0.12) < 0.1);
  CHECK(estimate.spread.positive == Approx(0.03).epsilon(0.25));
  CHECK(estimate.spread.negative == Approx(0.03).epsilon(0.25));
}

TEST_CASE("thresholds: exposures that overlap a little are neighbours", "[data]") {
  for (const int64_t overlap_us : {3, 4000}) {
    const auto data = sliding_pattern({0.25, 0.18}, 0, 0, -overlap_us);
    const ThresholdEstimate estimate = estimate_of(data, 0);
    CAPTURE(overlap_us, estimate.thresholds.positive, estimate.thresholds.negative);
    CHECK(estimate.found);
    CHECK(error_of(estimate, 0.25, 0.18) < 0.1);
  }
}

TEST_CASE("thresholds: events of one polarity determine none", "[data]") {
  Dataset data = sliding_pattern({0.25, 0.25}, 0, 0);
  const events::EventStream all = data.events;
  for (const int sign : {1, -1}) {
    const torch::Tensor some = all.polarity() == sign;
    data.events = {all.x().masked_select(some), all.y().masked_select(some),
                   all.t_us().masked_select(some), all.polarity().masked_select(some)};
    CHECK_FALSE(estimate_of(data, 0).found);
  }
}

TEST_CASE("thresholds: flipped events are not found, and their flip is named", "[data]") {
  const Dataset data = sliding_pattern({0.25, 0.18}, 0, 0);
  CHECK_FALSE(estimate_of(data, 0).flip);
  // This pattern looks much alike upside down.
  for (const EventFlip& flip : {EventFlip{true, false, false}, EventFlip{false, false, true}}) {
    Dataset flipped = data;
    flipped.events = flip.undone(data.events, {kSize, kSize});
    const ThresholdEstimate estimate = estimate_of(flipped, 0);
    CAPTURE(flip.name(), estimate.thresholds.positive, estimate.unexplained);
    CHECK_FALSE(estimate.found);
    REQUIRE(estimate.flip);
    CHECK(estimate.flip->name() == flip.name());
  }
}

TEST_CASE("thresholds: nothing is claimed without events", "[data]") {
  Dataset data = sliding_pattern({0.25, 0.25}, 0, 0);
  data.events = events::EventStream();
  CHECK_FALSE(estimate_of(data, 0).found);
  data = sliding_pattern({0.25, 0.25}, 0, 0);
  data.train.resize(3);
  CHECK_FALSE(estimate_of(data, 0).found);
}

TEST_CASE("thresholds: events that belong to other frames explain nothing", "[data]") {
  Dataset data = sliding_pattern({0.25, 0.25}, 0, 0);
  torch::manual_seed(3);
  for (Exposure& exposure : data.train) {
    exposure.blurry = torch::rand({1, kSize, kSize}).expand({3, -1, -1}) * 0.8 + 0.1;
  }
  CHECK_FALSE(estimate_of(data, 0).found);
}

TEST_CASE("thresholds: the search stops on an interrupt", "[data]") {
  const Dataset data = sliding_pattern({0.25, 0.25}, 0, 0);
  set_interrupt_requested(true);
  CHECK_THROWS_AS(estimate_of(data, 0), Interrupted);
  set_interrupt_requested(false);
}

}  // namespace
}  // namespace jade::data
