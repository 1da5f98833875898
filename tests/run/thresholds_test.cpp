// SPDX-License-Identifier: Apache-2.0
#include "jade/run/thresholds.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <tuple>

#include "jade/core/atomic_file.h"
#include "jade/core/log.h"
#include "jade/run/trainer.h"
#include "support/temp_dir.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

constexpr double kPositive = 0.2, kNegative = 0.3;

double sliding_brightness(int64_t x, int64_t y, double t_us) {
  const double u = 0.35 * (double(x) - 6e-5 * t_us);
  return 0.5 + 0.25 * std::sin(u) + 0.15 * std::sin(0.6 * u + 0.5 * double(y));
}

/// A pattern that slides in front of a sensor with thresholds kPositive and kNegative; eight
/// exposures of 80 ms.
data::Dataset make_sliding_scene() {
  constexpr int64_t kSize = 24, kStep = 500, kPeriod = 120000, kDuration = 80000;
  constexpr int64_t kExposures = 8, kMeans = 17;
  std::vector<std::tuple<int64_t, float, float, int8_t>> events;
  torch::Tensor frames = torch::zeros({kExposures, kSize, kSize}, torch::kFloat64);
  for (int64_t y = 0; y < kSize; ++y) {
    for (int64_t x = 0; x < kSize; ++x) {
      double reference = std::log(sliding_brightness(x, y, 0));
      for (int64_t t = kStep; t <= kExposures * kPeriod; t += kStep) {
        const double now = std::log(sliding_brightness(x, y, double(t)));
        for (; now - reference >= kPositive; reference += kPositive)
          events.emplace_back(t, x, y, int8_t{1});
        for (; reference - now >= kNegative; reference -= kNegative)
          events.emplace_back(t, x, y, int8_t{-1});
      }
      for (int64_t i = 0; i < kExposures; ++i) {
        for (int64_t k = 0; k < kMeans; ++k) {
          const double t = double(kPeriod * i) + double(kDuration * k) / double(kMeans - 1);
          frames[i][y][x] += sliding_brightness(x, y, t) / double(kMeans);
        }
      }
    }
  }
  std::stable_sort(events.begin(), events.end(),
                   [](const auto& a, const auto& b) { return std::get<0>(a) < std::get<0>(b); });
  std::vector<float> xs, ys;
  std::vector<int64_t> ts;
  std::vector<int8_t> ps;
  for (const auto& [t, x, y, p] : events) {
    xs.push_back(x), ys.push_back(y), ts.push_back(t), ps.push_back(p);
  }
  data::Dataset scene;
  scene.events = events::EventStream::from_lists(xs, ys, ts, ps);
  for (int64_t i = 0; i < kExposures; ++i) {
    data::Exposure exposure;
    exposure.t_start_us = kPeriod * i, exposure.t_end_us = kPeriod * i + kDuration;
    exposure.camera = geometry::Intrinsics::centred(50, kSize, kSize);
    exposure.blurry = frames[i].to(torch::kFloat32).expand({3, -1, -1}).contiguous();
    exposure.events = scene.events.slice(exposure.t_start_us, exposure.t_end_us);
    scene.train.push_back(std::move(exposure));
  }
  return scene;
}

const data::Dataset& sliding_scene() {
  static const data::Dataset scene = make_sliding_scene();
  return scene;
}

/// Settings with a cache of their own, and the messages logged.
struct Settling {
  test::TempDir dir;
  train::RunOptions options;

  Settling() {
    set_log_level("error");
    options.cache.folder = dir / "cache";
  }

  std::string settle(const data::Dataset& dataset, const std::string& fingerprint = "a") {
    const auto said = dir / "said.txt";
    std::filesystem::remove(said);
    set_log_file(said);
    run::settle_thresholds(dataset, run::measure_thresholds(dataset, fingerprint, 0, options.cache),
                           options);
    set_log_file({});
    return read_file(said);
  }

  size_t kept() const {
    const std::filesystem::directory_iterator files(dir / "cache");
    return static_cast<size_t>(std::distance(begin(files), end(files)));
  }
};

size_t count_of(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

}  // namespace

TEST_CASE("thresholds: auto becomes what the data tell, kept with the restorations", "[run]") {
  const data::Dataset& scene = sliding_scene();
  Settling a;
  REQUIRE(a.options.events.threshold_positive.is_auto());
  a.settle(scene);
  const events::EventOptions first = a.options.events;
  CHECK_FALSE(first.threshold_positive.is_auto());
  CHECK(first.threshold_positive == Approx(kPositive).epsilon(0.2));
  CHECK(first.threshold_negative == Approx(kNegative).epsilon(0.2));
  CHECK(a.kept() == 1);
  // The second result comes from the cache, even though the events are gone.
  a.options.events = {};
  data::Dataset other = scene;
  other.events = scene.events.slice(0, 200000);
  a.settle(other);
  CHECK(a.options.events.threshold_positive == double(first.threshold_positive));
  CHECK(a.options.events.threshold_negative == first.threshold_negative);
  // Other data are measured again.
  a.options.events = {};
  a.settle(other, "b");
  CHECK(a.options.events.threshold_positive == 0.25);
}

TEST_CASE("thresholds: reversed polarity is warned of, with numbers and without", "[run]") {
  data::Dataset scene = sliding_scene();
  scene.events = data::EventFlip{false, false, true}.undone(scene.events, {1, 1});
  Settling a;
  CHECK_THAT(a.settle(scene), Catch::Contains("polarit") && Catch::Contains("0.25"));
  a.options.events = {};
  a.options.events.threshold_positive = 0.2;
  CHECK_THAT(a.settle(scene), Catch::Contains("polarit"));
}

TEST_CASE("thresholds: turned events are named, also from the cache", "[run]") {
  // This pattern looks the same turned either way.
  const data::EventFlip clockwise{true, false, false, true};
  data::Dataset scene = sliding_scene();
  scene.events = clockwise.undone(scene.events, {24, 24});
  Settling a;
  CHECK_THAT(a.settle(scene), Catch::Contains("90 degrees"));
  a.options.events = {};
  CHECK_THAT(a.settle(scene), Catch::Contains("90 degrees"));
}

TEST_CASE("thresholds: numbers win over what is measured, and a negative one alone does", "[run]") {
  const data::Dataset& scene = sliding_scene();
  Settling a;
  a.options.events.threshold_negative = 0.28;
  a.settle(scene);
  CHECK(a.options.events.threshold_positive == Approx(kPositive).epsilon(0.2));
  CHECK(a.options.events.threshold_negative == 0.28);
  a.options.events.threshold_positive = 0.24;
  a.options.events.threshold_negative = 0;
  CHECK(count_of(a.settle(scene), "warn") == 0);
  CHECK(a.options.events.thresholds().negative == 0.24);
}

TEST_CASE("thresholds: a configured pair far from the measured one gets one warning", "[run]") {
  const data::Dataset& scene = sliding_scene();
  Settling a;
  a.options.events.threshold_positive = 0.5;
  const std::string said = a.settle(scene);
  CHECK(count_of(said, "warn") == 1);
  CHECK_THAT(said, Catch::Contains("events.threshold_positive") && Catch::Contains("0.5 and 0.5") &&
                       Catch::Contains("measured are 0."));
  CHECK(a.options.events.thresholds().positive == 0.5);
}

TEST_CASE("thresholds: data that do not determine them give 0.25, said in one line", "[run]") {
  const data::Dataset& whole = sliding_scene();
  data::Dataset silent = whole, single = whole, flat = whole, empty;
  silent.events = {};
  single.train.resize(1);
  for (data::Exposure& each : flat.train) each.blurry = torch::full_like(each.blurry, 0.5);
  for (const data::Dataset* each : {&silent, &single, &flat, &empty}) {
    Settling a;
    const std::string said = a.settle(*each);
    CHECK(count_of(said, "\n") == 1);
    CHECK_FALSE(a.options.events.threshold_positive.is_auto());
    CHECK(a.options.events.thresholds().positive == 0.25);
    CHECK(a.options.events.thresholds().negative == 0.25);
  }
}

TEST_CASE("thresholds: the run's config.yaml holds numbers, and a resumed run goes on with them",
          "[run]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  options.events.threshold_positive = AutoNumber::automatic(0.25);
  options.train.iterations = options.train.calendar = 4;
  options.cache.folder = scene.dir / "cache";
  const auto run = scene.dir / "run";
  events::Thresholds began;
  {
    run::Trainer trainer(options, run, "");
    began = trainer.options().events.thresholds();
    trainer.run();
  }
  CHECK_THAT(read_file(run / "config.yaml"), !Catch::Contains("threshold_positive: auto"));
  options.cache.enabled = false;
  const run::Trainer again(options, run, "latest");
  CHECK_FALSE(again.options().events.threshold_positive.is_auto());
  CHECK(again.options().events.thresholds().positive == began.positive);
  CHECK(again.options().events.thresholds().negative == began.negative);
}
