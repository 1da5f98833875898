// SPDX-License-Identifier: Apache-2.0
#include "jade/data/event_consistency.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

namespace jade::data {
namespace {

constexpr int64_t kSide = 32;
constexpr double kThreshold = 0.25;

struct Slides {
  std::vector<torch::Tensor> frames;
  std::vector<events::TimeWindow> exposures;
  events::EventStream events;
};

/// A pattern that slides over the sensor back and forth, with brightness `light` times (0.1 to
/// 0.9).
/// @param read_noise,fixed  standard deviations of each frame's own noise and of a pattern in all
///   of them
Slides sliding(double light, double read_noise, double fixed) {
  torch::manual_seed(6);
  const auto at = [](int64_t x, int64_t y, double t_us) {
    const double u = 0.35 * (double(x) - 18 * std::sin(7e-6 * t_us));
    return 0.5 + 0.25 * std::sin(u) + 0.15 * std::sin(0.6 * u + 0.5 * double(y));
  };
  struct Event {
    float x, y;
    int64_t t_us;
    int8_t polarity;
  };
  std::vector<Event> events;
  for (int64_t y = 0; y < kSide; ++y) {
    for (int64_t x = 0; x < kSide; ++x) {
      double reference = std::log(at(x, y, 0));
      for (int64_t t = 400; t <= 1250000; t += 400) {
        const double now = std::log(at(x, y, double(t)));
        for (; now - reference >= kThreshold; reference += kThreshold) {
          events.push_back({float(x), float(y), t, 1});
        }
        for (; reference - now >= kThreshold; reference -= kThreshold) {
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
  for (const Event& e : events) {
    xs.push_back(e.x), ys.push_back(e.y), ts.push_back(e.t_us), ps.push_back(e.polarity);
  }
  Slides out;
  out.events = events::EventStream::from_lists(xs, ys, ts, ps);
  const torch::Tensor pattern = fixed * torch::randn({kSide, kSide});
  for (int64_t i = 0; i < 12; ++i) {
    out.exposures.push_back({10000 + 100000 * i, 70000 + 100000 * i});
    torch::Tensor frame = torch::zeros({kSide, kSide});
    auto value = frame.accessor<float, 2>();
    for (int64_t k = 0; k < 16; ++k) {
      for (int64_t y = 0; y < kSide; ++y) {
        for (int64_t x = 0; x < kSide; ++x) {
          const double t = double(out.exposures.back().begin_us) + 3750 * (double(k) + 0.5);
          value[y][x] += float(light * at(x, y, t) / 16);
        }
      }
    }
    out.frames.push_back((frame + pattern + read_noise * torch::randn({kSide, kSide}))
                             .clamp(0, 1)
                             .expand({3, -1, -1}));
  }
  return out;
}

ConsistencyFit fit_of(const Slides& s, double share = 1) {
  ConsistencyOptions options;
  options.rounds = 10;
  const EventConsistency consistency(s.frames, std::vector<bool>(s.frames.size() - 1, true),
                                     s.events, {0, 1300000}, options);
  std::vector<events::TimeWindow> windows;
  for (const events::TimeWindow& w : s.exposures) {
    const auto off = int64_t(0.5 * (1 - share) * double(w.duration_us()));
    windows.push_back({w.begin_us + off, w.end_us - off});
  }
  return consistency.fit(windows);
}

double error_of(const ConsistencyFit& fit) {
  return std::max(std::abs(fit.thresholds.positive / kThreshold - 1),
                  std::abs(fit.thresholds.negative / kThreshold - 1));
}

TEST_CASE("event consistency: thresholds hold in the dark, behind noise", "[data]") {
  const ConsistencyFit light = fit_of(sliding(1, 0, 0));
  REQUIRE(light.solved);
  CAPTURE(light.thresholds.positive, light.thresholds.negative, light.noise, light.frame_noise);
  CHECK(error_of(light) < 0.13);
  CHECK(light.standard_error.positive < 0.02);
  for (const double fixed : {0.0, 0.02}) {
    const ConsistencyFit dark = fit_of(sliding(0.25, 0.02, fixed));
    REQUIRE(dark.solved);
    CAPTURE(fixed, dark.thresholds.positive, dark.thresholds.negative, dark.noise);
    CHECK(error_of(dark) < 0.15);
    CHECK(dark.frame_noise == Approx(0.02).epsilon(0.4));
  }
}

TEST_CASE("event consistency: the true exposures agree best", "[data]") {
  const Slides s = sliding(0.5, 0.01, 0);
  const double right = fit_of(s).loss;
  CHECK(right < fit_of(s, 0.75).loss);
  CHECK(right < fit_of(s, 1.25).loss);
  CHECK(fit_of(s).part_losses.size() == 8);
}

TEST_CASE("event consistency: events count gradually from the one before", "[data]") {
  const auto stream = events::EventStream::from_lists({1, 1, 1, 0}, {0, 0, 0, 0},
                                                      {10000, 20000, 60000, 70000}, {1, 1, 1, -1});
  const PixelCurves curves(stream, {1, 2}, torch::tensor({1, 0}, torch::kInt64));
  const torch::Tensor until = curves.until({65000, 15000, 50000, 10000});
  REQUIRE(until.sizes() == torch::IntArrayRef({2, 2, 4}));
  CHECK(until[0][0][0].item<double>() == Approx(3));
  CHECK(until[0][0][1].item<double>() == Approx(1.5));
  // For at most 20 ms.
  CHECK(until[0][0][2].item<double>() == Approx(2.5));
  CHECK(until[0][0][3].item<double>() == Approx(1));
  CHECK(until[1][1][0].item<double>() == Approx(0));
  CHECK(until[0][1].abs().sum().item<double>() == 0);
}

}  // namespace
}  // namespace jade::data
