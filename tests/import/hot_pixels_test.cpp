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
  const auto hot = import::find_hot_pixels(noisy_recording(), {kHeight, kWidth});
  REQUIRE(hot.size() == 2);
  CHECK((hot[0].row == 11 && hot[0].column == 30));
  CHECK(hot[0].rate_hz == Approx(1530).epsilon(0.1));
  CHECK(hot[0].neighbours_hz == Approx(30).epsilon(0.2));
  CHECK((hot[1].row == 3 && hot[1].column == 7));
}

TEST_CASE("hot pixels: nothing and little are no reason to accuse a pixel", "[import]") {
  CHECK(import::find_hot_pixels({}, {4, 4}).empty());
  const auto few = events::EventStream::from_lists({1, 1, 9}, {1, 1, 1}, {1, 2, 3}, {1, 1, 1});
  CHECK(import::find_hot_pixels(few, {4, 4}).empty());
}

TEST_CASE("hot pixels: events on every other pixel accuse none but the hot one", "[import]") {
  const auto all = noisy_recording();
  const auto hot = import::find_hot_pixels({2 * all.x(), 2 * all.y(), all.t_us(), all.polarity()},
                                           {2 * kHeight, 2 * kWidth});
  REQUIRE(hot.size() == 2);
  CHECK((hot[0].row == 22 && hot[0].column == 60));
  CHECK((hot[1].row == 6 && hot[1].column == 14));
}

TEST_CASE("hot pixels: small groups are found where all other pixels are silent", "[import]") {
  const auto all = noisy_recording();
  torch::Tensor x = torch::arange(2000), y = 50 + (x / 2).floor() % 2;
  x = 5 + x % 2;
  const auto with = [](const torch::Tensor& list, const torch::Tensor& more) {
    return torch::cat({list, more.to(list.dtype())});
  };
  const torch::Tensor last = torch::full({2000}, all.last_us());
  CHECK(import::find_hot_pixels({with(all.x(), x), with(all.y(), y), with(all.t_us(), last),
                                 with(all.polarity(), torch::ones(2000))},
                                {kHeight + 40, kWidth})
            .size() == 2 + 4);
}
