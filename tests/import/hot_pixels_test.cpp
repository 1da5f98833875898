// SPDX-License-Identifier: Apache-2.0
#include "jade/import/hot_pixels.h"

#include "support/catch.h"

#include <algorithm>
#include <random>
#include <torch/types.h>
#include <vector>

using namespace jade;

namespace {

constexpr int64_t kHeight = 40, kWidth = 60;

/// A second of events: a few everywhere, many along an edge that moves through the columns from 20
/// to 40, and two hot pixels, one of them in the edge's path.
events::EventStream noisy_recording() {
  std::mt19937 random(2);
  struct Event {
    float x, y;
    int64_t t;
  };
  std::vector<Event> all;
  std::uniform_int_distribution<int64_t> time(0, 999999);
  const auto send = [&](int64_t x, int64_t y, double mean) {
    const int count = std::poisson_distribution<int>(mean)(random);
    for (int i = 0; i < count; ++i) all.push_back({float(x), float(y), time(random)});
  };
  for (int64_t y = 0; y < kHeight; ++y) {
    for (int64_t x = 0; x < kWidth; ++x) send(x, y, x >= 20 && x < 40 ? 30 : 1);
  }
  send(7, 3, 200);
  send(30, 11, 1500);
  std::sort(all.begin(), all.end(), [](const Event& a, const Event& b) { return a.t < b.t; });
  std::vector<float> xs, ys;
  std::vector<int64_t> ts;
  for (const Event& event : all)
    xs.push_back(event.x), ys.push_back(event.y), ts.push_back(event.t);
  return events::EventStream::from_lists(xs, ys, ts, std::vector<int8_t>(all.size(), 1));
}

}  // namespace

TEST_CASE("hot pixels: those that stand alone are found, an edge is not", "[import]") {
  import::PixelCounter counter({kHeight, kWidth});
  counter.add(noisy_recording());
  CHECK(counter.seconds() == Approx(1).epsilon(0.01));
  const auto hot = import::find_hot_pixels(counter);
  REQUIRE(hot.pixels.size() == 2);
  CHECK((hot.pixels[0].row == 11 && hot.pixels[0].column == 30));
  CHECK(hot.pixels[0].rate_hz == Approx(1530).epsilon(0.1));
  CHECK(hot.pixels[0].neighbours_hz == Approx(30).epsilon(0.2));
  CHECK((hot.pixels[1].row == 3 && hot.pixels[1].column == 7));
  CHECK((hot.mask[3][7].item<bool>() && hot.mask.sum().item<int64_t>() == 2));
}

TEST_CASE("hot pixels: parts of a recording add up to the whole", "[import]") {
  const auto all = noisy_recording();
  import::PixelCounter whole({kHeight, kWidth}), parts({kHeight, kWidth});
  whole.add(all);
  parts.add(all.range(0, all.size() / 3));
  parts.add(events::EventStream());
  parts.add(all.range(all.size() / 3, all.size()));
  CHECK(whole.counts().equal(parts.counts()));
  CHECK(whole.seconds() == parts.seconds());
  CHECK(whole.counts().sum().item<int64_t>() == all.size());
}

TEST_CASE("hot pixels: their events go, all others stay in order", "[import]") {
  const auto all = noisy_recording();
  import::PixelCounter counter({kHeight, kWidth}), after({kHeight, kWidth});
  counter.add(all);
  const auto hot = import::find_hot_pixels(counter);
  after.add(import::remove_events(all, hot.mask));
  CHECK(after.counts().equal(counter.counts() * hot.mask.logical_not()));
  CHECK(import::find_hot_pixels(after).pixels.empty());
}

TEST_CASE("hot pixels: nothing and little are no reason to accuse a pixel", "[import]") {
  import::PixelCounter counter({4, 4});
  CHECK(import::find_hot_pixels(counter).pixels.empty());
  counter.add(events::EventStream::from_lists({1, 1, 9}, {1, 1, 1}, {1, 2, 3}, {1, 1, 1}));
  CHECK(counter.counts().sum().item<int64_t>() == 2);
  CHECK(import::find_hot_pixels(counter).pixels.empty());
}

TEST_CASE("hot pixels: events on every other pixel accuse none but the hot one", "[import]") {
  const auto all = noisy_recording();
  import::PixelCounter fine({2 * kHeight, 2 * kWidth});
  fine.add({2 * all.x(), 2 * all.y(), all.t_us(), all.polarity()});
  const auto hot = import::find_hot_pixels(fine);
  REQUIRE(hot.pixels.size() == 2);
  CHECK((hot.pixels[0].row == 22 && hot.pixels[0].column == 60));
  CHECK((hot.pixels[1].row == 6 && hot.pixels[1].column == 14));
}

TEST_CASE("hot pixels: small groups are found where all other pixels are silent", "[import]") {
  std::vector<float> xs, ys;
  for (int i = 0; i < 2000; ++i)
    xs.push_back(float(5 + i % 2)), ys.push_back(float(50 + i / 2 % 2));
  std::vector<int64_t> times(xs.size(), 5);
  import::PixelCounter wide({kHeight + 40, kWidth});
  wide.add(noisy_recording());
  wide.add(events::EventStream::from_lists(xs, ys, times, std::vector<int8_t>(xs.size(), 1)));
  CHECK(import::find_hot_pixels(wide).pixels.size() == 2 + 4);
}
