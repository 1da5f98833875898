// SPDX-License-Identifier: Apache-2.0
#include "jade/import/color.h"

#include "support/catch.h"

#include <cmath>

#include "import/moving_pattern.h"
#include "jade/core/error.h"
#include "jade/imaging/color.h"
#include "jade/import/findings.h"
#include "support/naming.h"

using namespace jade;
using import::ColorFilter;

namespace {

/// Frames in colour whose channels change independently, and the events of a sensor behind a
/// filter.
test::PatternRecording colored(ColorFilter filter) {
  test::PatternMotion motion;
  motion.x_px = [](double t) { return 14 * std::sin(19 * t); };
  motion.y_px = [](double t) { return 9 * std::sin(23 * t + 2); };
  simulate::EventSensorOptions sensor;
  sensor.threshold_spread = 0.03;
  std::vector<test::PatternRecording> channels;
  for (const double turn : {0.0, 0.6, 1.2}) {
    auto own = motion;
    // Each channel uses another section of the texture.
    own.x_px = [&motion, turn](double t) { return motion.x_px(t) + 30 * turn; };
    channels.push_back(test::record_pattern(own, sensor));
  }
  test::PatternRecording result;
  for (size_t i = 0; i < channels[0].exposures.size(); ++i) {
    data::Exposure exposure = channels[0].exposures[i];
    exposure.blurry = torch::cat({channels[0].exposures[i].blurry.slice(0, 0, 1),
                                  channels[1].exposures[i].blurry.slice(0, 0, 1),
                                  channels[2].exposures[i].blurry.slice(0, 0, 1)});
    result.exposures.push_back(std::move(exposure));
  }
  std::vector<torch::Tensor> x, y, t, p;
  for (int64_t c = 0; c < 3; ++c) {
    const auto& events = channels[size_t(c)].events;
    const torch::Tensor row = events.y().to(torch::kInt64) % 2;
    const torch::Tensor column = events.x().to(torch::kInt64) % 2;
    torch::Tensor keep = torch::zeros({events.size()}, torch::kBool);
    for (int64_t place = 0; place < 4; ++place) {
      if (import::channel_of(filter, place / 2, place % 2) != c) continue;
      keep = keep | ((row == place / 2) & (column == place % 2));
    }
    x.push_back(events.x().masked_select(keep)), y.push_back(events.y().masked_select(keep));
    t.push_back(events.t_us().masked_select(keep));
    p.push_back(events.polarity().masked_select(keep));
  }
  const torch::Tensor times = torch::cat(t), order = times.argsort();
  result.events = events::EventStream(
      torch::cat(x).index_select(0, order), torch::cat(y).index_select(0, order),
      times.index_select(0, order), torch::cat(p).index_select(0, order));
  return result;
}

}  // namespace

TEST_CASE("color: channels of the four filters", "[import]") {
  CHECK(import::channel_of(ColorFilter::kRggb, 0, 0) == 0);
  CHECK(import::channel_of(ColorFilter::kRggb, 2, 3) == 1);
  CHECK(import::channel_of(ColorFilter::kRggb, 1, 1) == 2);
  CHECK(import::channel_of(ColorFilter::kBggr, 0, 0) == 2);
  CHECK(import::channel_of(ColorFilter::kBggr, 1, 1) == 0);
  CHECK(import::channel_of(ColorFilter::kGrbg, 0, 0) == 1);
  CHECK(import::channel_of(ColorFilter::kGrbg, 0, 1) == 0);
  CHECK(import::channel_of(ColorFilter::kGbrg, 1, 0) == 0);
  CHECK(import::channel_of(ColorFilter::kGbrg, 0, 1) == 2);
  CHECK_THROWS_AS(import::channel_of(ColorFilter::kNone, 0, 0), ContractError);
}

TEST_CASE("color: the filter before the event pixels is found", "[import]") {
  for (const auto filter : {ColorFilter::kRggb, ColorFilter::kGbrg}) {
    const auto recording = colored(filter);
    const auto found = import::find_event_filter(recording.exposures, recording.events);
    CAPTURE(found.gray_correlation, found.filter_correlation);
    CHECK(found.filter == filter);
    CHECK(found.filter_correlation > found.gray_correlation);
  }
}

TEST_CASE("color: gray events and gray frames have no filter", "[import]") {
  auto recording = colored(ColorFilter::kRggb);
  for (auto& exposure : recording.exposures) exposure.blurry = imaging::as_gray(exposure.blurry);
  CHECK(import::find_event_filter(recording.exposures, recording.events).filter ==
        ColorFilter::kNone);
  test::PatternMotion motion;
  motion.x_px = [](double t) { return 14 * std::sin(19 * t); };
  motion.y_px = [](double t) { return 9 * std::sin(23 * t + 2); };
  auto gray = test::record_pattern(motion, {});
  const torch::Tensor tint = torch::tensor({1.0f, 0.8f, 0.6f}).reshape({3, 1, 1});
  for (auto& exposure : gray.exposures) exposure.blurry = exposure.blurry * tint;
  CHECK(import::find_event_filter(gray.exposures, gray.events).filter == ColorFilter::kNone);
  CHECK(import::find_event_filter({}, gray.events).filter == ColorFilter::kNone);
}

TEST_CASE("color: thresholds behind a filter are found in the channel of each pixel", "[import]") {
  const auto recording = colored(ColorFilter::kGrbg);
  import::Capture capture;
  for (const data::Exposure& e : recording.exposures) {
    capture.shots.push_back({concat(e.t_start_us), e.blurry, e.t_start_us, e.t_end_us, 0});
  }
  capture.events = recording.events;
  capture.sensor = {capture.height(), capture.width()};
  const import::SensorFinding found = import::find_sensor({}, {}, capture);
  CAPTURE(found.said, found.thresholds.positive, found.thresholds.negative);
  CHECK(found.filter == ColorFilter::kGrbg);
  CHECK_THAT(found.said, test::naming("grbg"));
  const simulate::EventSensorOptions truth;
  CHECK(found.thresholds.positive == Approx(truth.threshold_positive).epsilon(0.08));
  CHECK(found.thresholds.negative == Approx(truth.threshold_negative).epsilon(0.08));
}
