// SPDX-License-Identifier: Apache-2.0
#include "jade/import/findings.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "import/moving_pattern.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

/// Some exposures with hand motion, events `ahead_us` ahead of them, and a hot pixel.
import::Capture capture_ahead(int64_t ahead_us, int64_t exposures = 8,
                              int64_t exposure_us = 30000){simulate::EventSensorOptions sensor;
sensor.threshold_positive = 0.2, sensor.threshold_negative = 0.25;
sensor.threshold_spread = 0.03;
test::PatternMotion motion;
motion.exposures = exposures;
motion.exposure_us = exposure_us, motion.gap_us = 50000 - exposure_us;
motion.x_px = [](double t) { return 14 * std::sin(19 * t) + 5 * std::sin(41 * t + 1); };
motion.y_px = [](double t) { return 9 * std::sin(23 * t + 2) + 4 * std::sin(37 * t); };
const test::PatternRecording recording = test::record_pattern(motion, sensor);
import::Capture capture;
capture.source = "table";
for (const data::Exposure& e : recording.exposures) {
  capture.shots.push_back({concat(e.t_start_us), e.blurry, e.t_start_us, e.t_end_us, 0});
}
capture.sensor = {motion.height, motion.width};
const events::EventStream& e = recording.events;
const int64_t hot = 5000;
const torch::Tensor times = torch::linspace(e.first_us(), e.last_us(), hot).to(torch::kInt64);
const auto joined = [](const torch::Tensor& a, const torch::Tensor& b) {
  return torch::cat({a, b.to(a.scalar_type())});
};
const torch::Tensor t = joined(e.t_us(), times);
const torch::Tensor order = t.argsort(/*stable=*/true, 0, false);
const auto sorted = [&](const torch::Tensor& all) { return all.index_select(0, order); };
capture.events = events::EventStream(
    sorted(joined(e.x(), torch::full({hot}, 30))), sorted(joined(e.y(), torch::full({hot}, 21))),
    sorted(t) + ahead_us, sorted(joined(e.polarity(), torch::ones({hot}))));
return capture;
}  // namespace

}  // namespace

TEST_CASE("findings: the offset is found, given or one clock", "[import]") {
  const import::Capture ahead = capture_ahead(13000), level = capture_ahead(0);
  const import::ClockFinding found = import::find_clock({}, ahead, true);
  CHECK(found.offset_ms == Approx(13).margin(2));
  // From −50 ms in steps of one.
  REQUIRE(found.curve.size() == 101);
  CHECK(std::max_element(found.curve.begin(), found.curve.end()) - found.curve.begin() ==
        Approx(50 + found.offset_ms).margin(1));
  CHECK(import::find_clock({}, level, true).offset_ms == 0);
  import::TimeOptions options;
  options.offset_ms = 7;
  CHECK(import::find_clock(options, ahead, true).offset_ms == 7);
  CHECK(import::find_clock(options, ahead, true).curve.empty());
  options.offset_ms = 0;
  options.find_offset = false;
  CHECK(import::find_clock(options, ahead, true).offset_ms == 0);
}

TEST_CASE("findings: clocks at two rates are named", "[import]") {
  import::Capture fast = capture_ahead(0, 24);
  const events::EventStream& e = fast.events;
  const torch::Tensor t = (e.t_us().to(torch::kFloat64) * 1.03).round().to(torch::kInt64);
  fast.events = events::EventStream(e.x(), e.y(), t, e.polarity());
  CHECK_THAT(import::find_clock({}, fast, true).said, test::naming("although the rates differ"));
  CHECK_THAT(import::find_clock({}, capture_ahead(0, 24), true).said, !test::naming("rates"));
}

TEST_CASE("findings: an offset in doubt must be given where frames and events are two recordings",
          "[import]") {
  import::Capture still = capture_ahead(0);
  for (import::Shot& shot : still.shots) shot.image = still.shots[0].image;
  CHECK_THROWS_NAMING(DataError, import::find_clock({}, still, true), "--offset-ms", "-50 to 50");
  const import::ClockFinding one = import::find_clock({}, still, false);
  CHECK(one.offset_ms == 0);
  CHECK_THAT(one.said, test::naming("one clock"));
}

TEST_CASE("findings: events that lie mirrored are named, with and without exposures", "[import]") {
  import::Capture mirrored = capture_ahead(0);
  const events::EventStream& e = mirrored.events;
  mirrored.events = events::EventStream(e.x(), 47 - e.y(), e.t_us(), e.polarity());
  CHECK_THAT(import::find_clock({}, mirrored, false).said, test::naming("flipped"));
  CHECK_THROWS_NAMING(DataError, import::find_clock({}, mirrored, true), "47 - y");
  for (import::Shot& shot : mirrored.shots) shot.t_end_us = shot.t_start_us;
  mirrored.shots.resize(3);
  CHECK_THROWS_NAMING(DataError, import::find_exposures(mirrored, std::nullopt), "47 - y");
}

TEST_CASE("findings: hot pixels go and thresholds are found, unless they are given", "[import]") {
  import::Capture capture = capture_ahead(0);
  const import::SensorFinding found = import::find_sensor({}, {}, capture);
  CAPTURE(found.said);
  REQUIRE(found.hot_pixels.size() == 1);
  CHECK(found.hot_pixels[0].row == 21);
  CHECK(found.hot_pixels[0].column == 30);
  CHECK(found.thresholds.positive == Approx(0.2).epsilon(0.15));
  CHECK(found.thresholds.negative == Approx(0.25).epsilon(0.15));
  const int64_t before = capture.events.size();
  import::clean(found, capture);
  CHECK(capture.events.size() <= before - 5000);

  events::EventOptions given;
  given.threshold_positive = 0.3;
  CHECK(import::find_sensor({}, given, capture).hot_pixels.empty());
  CHECK(import::find_sensor({}, given, capture).thresholds.negative == 0.3);
  import::SensorOptions off;
  off.find_thresholds = off.remove_hot_pixels = false;
  const import::SensorFinding none = import::find_sensor(off, {}, capture_ahead(0));
  CHECK(none.hot_pixels.empty());
  CHECK(none.thresholds.positive == 0.25);
}

TEST_CASE("findings: shots between moving ones are sharp, those that noise hides are not known",
          "[import]") {
  import::Capture capture = import::without_hot_pixels(capture_ahead(0));
  const int64_t end = capture.shots[0].t_end_us;
  capture.shots.insert(capture.shots.begin() + 1,
                       {"short", capture.shots[0].image, end + 10000, end + 10001});
  const std::vector<double> blur = import::find_blur(capture);
  REQUIRE(blur.size() == 9);
  for (size_t i = 0; i < blur.size(); ++i) {
    CAPTURE(i, blur[i]);
    CHECK((blur[i] >= 0 && blur[i] < 1) == (i == 1));
  }
  CHECK(*std::max_element(blur.begin(), blur.end()) > 4);
  // A camera whose events were lost is not at rest.
  import::Capture lost = capture;
  const import::Shot& gone = lost.shots[4];
  const torch::Tensor t = lost.events.t_us();
  const torch::Tensor kept = t.lt(gone.t_start_us).logical_or(t.ge(gone.t_end_us - 3000));
  lost.events = {lost.events.x().masked_select(kept), lost.events.y().masked_select(kept),
                 t.masked_select(kept), lost.events.polarity().masked_select(kept)};
  CHECK(import::find_blur(lost)[4] == -1);
  // Events that end before most of the exposures.
  import::Capture ended = capture;
  ended.events = ended.events.slice(ended.events.first_us(), ended.shots[3].t_start_us);
  const std::vector<double> known = import::find_blur(ended);
  CHECK(std::count(known.begin() + 3, known.end(), -1) == 6);
  // A static recording with the same number of events.
  const int64_t count = capture.events.size();
  torch::manual_seed(1);
  const torch::Tensor evenly =
      torch::linspace(capture.events.first_us(), capture.events.last_us(), count, torch::kFloat64);
  capture.events = events::EventStream(torch::rand({count}) * 64, torch::rand({count}) * 48,
                                       evenly.to(torch::kInt64), capture.events.polarity());
  const std::vector<double> drowned = import::find_blur(capture);
  for (size_t i = 0; i < drowned.size(); ++i) {
    CAPTURE(i, drowned[i]);
    CHECK((drowned[i] < 0) == (i != 1));
  }
}

TEST_CASE("findings: exposures are found and set where frames have one time each", "[import]") {
  import::Capture capture = import::without_hot_pixels(capture_ahead(0));
  CHECK_FALSE(import::lacks_exposures(capture));
  const std::vector<import::Shot> truth = capture.shots;
  for (import::Shot& shot : capture.shots) shot.t_end_us = shot.t_start_us;
  REQUIRE(import::lacks_exposures(capture));
  const import::ExposureFinding found = import::find_exposures(capture, std::nullopt);
  CHECK((found.stamp == recording::Stamp::kStart));
  import::set_exposures(found, capture);
  CHECK(capture.shots[3].t_start_us == truth[3].t_start_us);
  CHECK(double(capture.shots[3].duration_us()) ==
        Approx(double(truth[3].duration_us())).epsilon(0.1));
  CHECK_THAT(found.said, !test::naming("doubtful"));
  import::Capture quick = import::without_hot_pixels(capture_ahead(0, 8, 5000));
  for (import::Shot& shot : quick.shots) shot.t_end_us = shot.t_start_us;
  CHECK_THAT(import::find_exposures(quick, std::nullopt).said, test::naming("doubtful"));
  import::Capture still = capture_ahead(0);
  for (import::Shot& shot : still.shots) shot.t_end_us = shot.t_start_us;
  still.events = {};
  CHECK_THROWS_AS(import::find_exposures(still, std::nullopt), DataError);
}

TEST_CASE("findings: what is kept is restored, what is damaged is named", "[import]") {
  const test::TempDir dir;
  import::SensorFinding sensor;
  sensor.hot_pixels = {{3, 4, 120, 2}, {0, 9, 50, 1}};
  sensor.thresholds = {0.31, 0.22};
  sensor.said = "two";
  sensor.blur_px = {4.5, -1, 0};
  sensor.filter = import::ColorFilter::kGrbg;
  import::keep(dir.path(), sensor);
  sensor.gains = {0.9, 1, 1.1};
  import::keep(dir.path(), sensor);
  import::keep(dir.path(), import::ClockFinding{-4.5, "found", { 0.25, 0.5 }});
  CHECK(import::load_exposures(dir.path()).length_us == 0);
  import::ExposureFinding exposures;
  exposures.length_us = 42000, exposures.stamp = recording::Stamp::kEnd;
  exposures.lengths_us = {30000, 42000}, exposures.losses = {-1.5, -2};
  import::keep(dir.path(), import::ClockFinding{-4.5, "found", { 0.25, 0.5 }}, exposures);
  CHECK(import::load_exposures(dir.path()).length_us == 42000);
  CHECK((import::load_exposures(dir.path()).stamp == recording::Stamp::kEnd));
  CHECK(import::load_exposures(dir.path()).losses == exposures.losses);
  CHECK(import::load_sensor(dir.path()).gains == sensor.gains);
  const import::SensorFinding back = import::load_sensor(dir.path());
  CHECK(back.hot_pixels.size() == 2);
  CHECK(back.hot_pixels[1].column == 9);
  CHECK(back.thresholds.negative == 0.22);
  CHECK(back.said == "two");
  CHECK(back.blur_px == sensor.blur_px);
  CHECK((back.filter == import::ColorFilter::kGrbg));
  CHECK(import::load_clock(dir.path()).offset_ms == -4.5);
  CHECK(import::load_clock(dir.path()).curve == std::vector<double>{0.25, 0.5});
  write_file(dir / "clock.json", "{}");
  CHECK_THROWS_WITH(import::load_clock(dir.path()), Catch::Contains("clock.json"));
}
