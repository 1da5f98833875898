// SPDX-License-Identifier: Apache-2.0
#include "jade/events/exposure_maps.h"

#include "support/catch.h"

#include <ATen/Parallel.h>
#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "random_events.h"
#include "support/signed_bins.h"

using namespace jade::events;
using namespace jade::test;

TEST_CASE("map exposure: it gives what the separate functions give", "[events]") {
  const auto events = random_events(4000, 1, 10000, 4).stream();
  const TimeWindow exposure{1003, 8017};
  const auto maps = map_exposure(events, exposure, 6, kSize);
  const auto voxel = voxelize(events, exposure, 6, kSize);
  CHECK(torch::equal(maps.voxel.values, voxel.values));
  CHECK(maps.voxel.v_max == voxel.v_max);
  CHECK(worst(maps.windows.positive - maps.windows.negative,
              signed_bins(events, exposure, 8, kSize)) < 1e-5);
  CHECK(torch::equal(maps.density, event_density(events.slice(exposure), kSize)));
  CHECK(worst(maps.windows.positive.sum(0) + maps.windows.negative.sum(0), maps.density) < 1e-4);
}

TEST_CASE("map exposure: bands of rows give the exact counts, for any number of threads",
          "[events]") {
  const TimeWindow exposure{1003, 8017};
  const int threads = at::get_num_threads();
  for (const ImageSize& size : {ImageSize{1, 40}, kSize, ImageSize{150, 23}}) {
    const auto events = random_events(40000, 1.2f, 10000, 9, size).stream();
    const torch::Tensor windows = to_events(binned(events, exposure, 5, size));
    const torch::Tensor apart = to_events(binned(events, exposure, 7, size));
    for (const int number : {1, 3}) {
      at::set_num_threads(number);
      const auto maps = map_exposure(events, exposure, 6, size, 5, 7);
      CHECK(maps.voxel.values.equal(voxelize(events, exposure, 6, size).values));
      CHECK(maps.density.equal(event_density(events.slice(exposure), size)));
      CHECK(maps.windows.positive.equal(windows.select(1, 0)));
      CHECK(maps.windows.negative.equal(windows.select(1, 1)));
      CHECK(maps.signed_windows.equal(apart.select(1, 0) - apart.select(1, 1)));
    }
    at::set_num_threads(threads);
  }
  CHECK_FALSE(map_exposure(EventStream(), exposure, 6, kSize).signed_windows.defined());
  CHECK_THROWS_AS(map_exposure(EventStream(), exposure, 6, {0, 5}), jade::ContractError);
}

TEST_CASE("map exposure: exposures shorter than their bins, and without events, give finite maps",
          "[events]") {
  const auto events = random_events(50, 0, 3, 5).stream();
  for (const TimeWindow window : {TimeWindow{0, 3}, TimeWindow{1, 1}, TimeWindow{100, 200}}) {
    const auto maps = map_exposure(events, window, 6, kSize);
    CHECK(maps.density.sum().item<float>() == Approx(float(events.slice(window).size())));
    CHECK(maps.windows.positive.sizes() == torch::IntArrayRef({8, kSize.height, kSize.width}));
  }
}

TEST_CASE("edi windows: windows hold threshold times count, by polarity", "[events]") {
  const auto events = EventStream::from_lists({2, 3, 2}, {1, 1, 1}, {0, 100, 799}, {1, 1, -1});
  const auto windows = edi_windows(map_exposure(events, {0, 800}, 6, kSize).windows, {0.3, 0.2});
  CHECK(windows[0][1][2].item<float>() == Approx(0.3));
  CHECK(windows[1][1][3].item<float>() == Approx(0.3));
  CHECK(windows[7][1][2].item<float>() == Approx(-0.2));
  CHECK(windows.abs().sum().item<float>() == Approx(0.8));
}
