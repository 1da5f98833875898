// SPDX-License-Identifier: Apache-2.0
#include "jade/events/ramps.h"

#include "support/catch.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <map>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/events/count_math.h"
#include "jade/events/counts.h"
#include "random_events.h"

using namespace jade::events;
using namespace jade::test;

namespace {

/// Events of pixel (2, 1).
EventStream at_one_pixel(const std::vector<int64_t>& t, const std::vector<int8_t>& polarity) {
  const std::vector<float> x(t.size(), 2), y(t.size(), 1);
  return EventStream::from_lists(x, y, t, polarity);
}

/// Its windows.
std::vector<float> windows_of(const torch::Tensor& maps) {
  const torch::Tensor row = maps.select(1, 1).select(1, 2).contiguous();
  return {row.data_ptr<float>(), row.data_ptr<float>() + row.numel()};
}

using Windows = std::vector<float>;

/// Reference, event by event and window by window: [2,J,H,W].
torch::Tensor slow_ramps(const EventStream& events, const TimeWindow& exposure, int64_t parts,
                         int64_t reach_us, const ImageSize& size) {
  const auto width = int32_t(size.width), height = int32_t(size.height);
  torch::Tensor out = torch::zeros({2, parts, size.height, size.width});
  auto sums = out.accessor<float, 4>();
  const EventStream near = events.slice(exposure.begin_us - reach_us, exposure.end_us + reach_us);
  const torch::Tensor x = near.x(), y = near.y(), t = near.t_us(), p = near.polarity();
  std::map<std::pair<int, int>, int64_t> before;
  for (int64_t i = 0; i < near.size(); ++i) {
    EventFootprint f{};
    if (!locate(x[i].item<float>(), y[i].item<float>(), width, height, f)) continue;
    const int column = std::clamp(f.column + (f.fx >= kWhole / 2 ? 1 : 0), 0, width - 1);
    const int row = std::clamp(f.row + (f.fy >= kWhole / 2 ? 1 : 0), 0, height - 1);
    const int64_t end = t[i].item<int64_t>();
    int64_t begin = end - reach_us;
    const auto found = before.find({row, column});
    if (found != before.end()) begin = std::max(begin, found->second);
    before[{row, column}] = end;
    for (int64_t j = 0; j < parts; ++j) {
      const int64_t from = knot_us(exposure, j, parts), to = knot_us(exposure, j + 1, parts);
      float share = begin == end && from <= end && end < to ? 1.0f : 0.0f;
      if (const int64_t inside = std::min(end, to) - std::max(begin, from); inside > 0) {
        share = float(inside) / float(end - begin);
      }
      if (share == 0) continue;
      spread(f, width, height, [&](int64_t pixel, int64_t weight) {
        sums[p[i].item<int>() > 0 ? 0 : 1][j][pixel / width][pixel % width] +=
            share * float(weight * kCountUnit);
      });
    }
  }
  return out;
}

}  // namespace

TEST_CASE("ramps: the definition to the last bit, for any bands and number of threads",
          "[events]") {
  const int threads = at::get_num_threads();
  for (const ImageSize& size : {kSize, ImageSize{150, 5}}) {
    const auto events = random_events(6000, 1.2f, 30000, 11, size).stream();
    for (const int64_t reach : {0, 900, 12000}) {
      const TimeWindow exposure{9001, 21013};
      const torch::Tensor expected = slow_ramps(events, exposure, 8, reach, size);
      for (const int number : {1, 3}) {
        at::set_num_threads(number);
        const auto maps = ramped_windows(events, exposure, 8, reach, size);
        CHECK(maps.positive.equal(expected[0]));
        CHECK(maps.negative.equal(expected[1]));
      }
      at::set_num_threads(threads);
    }
  }
}

TEST_CASE("ramps: a step is spread over the time since the event before it", "[events]") {
  const auto events = at_one_pixel({0, 400}, {1, 1});
  const auto maps = ramped_windows(events, {0, 800}, 8, 1000, kSize);
  // The ramp of the first event lies before the exposure.
  CHECK(windows_of(maps.positive) == Windows{0.25f, 0.25f, 0.25f, 0.25f, 0, 0, 0, 0});
  CHECK(windows_of(maps.negative) == Windows(8, 0));
}

TEST_CASE("ramps: a line begins at most the reach before its event", "[events]") {
  const auto maps = ramped_windows(at_one_pixel({100, 600}, {1, -1}), {0, 800}, 8, 200, kSize);
  CHECK(windows_of(maps.positive) == Windows{0.5f, 0, 0, 0, 0, 0, 0, 0});
  CHECK(windows_of(maps.negative) == Windows{0, 0, 0, 0, 0.5f, 0.5f, 0, 0});
}

TEST_CASE("ramps: an event after the exposure counts with its part inside", "[events]") {
  const auto events = at_one_pixel({700, 900}, {1, 1});
  const auto maps = ramped_windows(events, {0, 800}, 8, 400, kSize);
  CHECK(windows_of(maps.positive) == Windows{0, 0, 0, 0.25f, 0.25f, 0.25f, 0.25f, 0.5f});
}

TEST_CASE("ramps: without reach they are the counts", "[events]") {
  const auto events = random_events(4000, 1, 10000, 4).stream();
  const TimeWindow exposure{1003, 8017};
  const auto counts = map_exposure(events, exposure, 6, kSize).windows;
  const auto maps = ramped_windows(events, exposure, 8, 0, kSize);
  CHECK(worst(maps.positive, counts.positive) < 1e-4);
  CHECK(worst(maps.negative, counts.negative) < 1e-4);
  CHECK(worst(ramped_windows(events, exposure, 8, 3000, kSize).positive, counts.positive) > 0.1);
}

TEST_CASE("ramps: two events at one moment are steps, and all shares add up to the events",
          "[events]") {
  const auto events = at_one_pixel({300, 300, 310}, {1, 1, 1});
  const auto maps = ramped_windows(events, {0, 800}, 8, 100, kSize);
  CHECK(maps.positive.sum().item<float>() == Approx(3));
  CHECK(windows_of(maps.positive)[3] == Approx(2));  // the second and the third
  CHECK_THROWS_AS(ramped_windows(events, {0, 800}, 0, 100, kSize), jade::ContractError);
}
