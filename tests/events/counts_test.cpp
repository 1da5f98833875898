// SPDX-License-Identifier: Apache-2.0
#include "jade/events/counts.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/events/exposure_maps.h"
#include "jade/events/voxel.h"
#include "support/devices.h"
#include "support/signed_bins.h"

using namespace jade::events;
using jade::test::signed_bins;
using jade::test::voxelize;

namespace {

constexpr ImageSize kSize{13, 17};

struct Lists {
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  EventStream stream() const { return EventStream::from_lists(x, y, t, p); }
};

/// Sub-pixel events on the image and up to `margin` px around it.
Lists random_events(int64_t count, float margin, int64_t t_end, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> u(-margin, float(kSize.width - 1) + margin);
  std::uniform_real_distribution<float> v(-margin, float(kSize.height - 1) + margin);
  std::uniform_int_distribution<int64_t> time(0, t_end - 1);
  Lists out;
  for (int64_t i = 0; i < count; ++i) {
    out.x.push_back(u(random));
    out.y.push_back(v(random));
    out.t.push_back(time(random));
    out.p.push_back(random() % 3 == 0 ? int8_t(-1) : int8_t(1));
  }
  std::sort(out.t.begin(), out.t.end());
  return out;
}

/// The definition, event by event in double.
torch::Tensor slow_bins(const Lists& events, int64_t begin, int64_t end, int64_t bins) {
  auto out = torch::zeros({bins, kSize.height, kSize.width}, torch::kFloat64);
  auto a = out.accessor<double, 3>();
  for (size_t i = 0; i < events.x.size(); ++i) {
    if (events.t[i] < begin || events.t[i] >= end) continue;
    const int64_t bin = (events.t[i] - begin) * bins / (end - begin);
    for (int64_t r = 0; r < kSize.height; ++r) {
      for (int64_t c = 0; c < kSize.width; ++c) {
        const double weight = std::max(0.0, 1 - std::abs(double(events.x[i]) - double(c))) *
                              std::max(0.0, 1 - std::abs(double(events.y[i]) - double(r)));
        a[bin][r][c] += weight * events.p[i];
      }
    }
  }
  return out;
}

double worst(const torch::Tensor& a, const torch::Tensor& b) {
  return (a.to(torch::kFloat64) - b.to(torch::kFloat64)).abs().max().item<double>();
}

}  // namespace

TEST_CASE("voxelize: bins agree with the definition, events beside the image included",
          "[events]") {
  const auto events = random_events(3000, 2.5f, 9973, 1);
  for (const int64_t bins : {1, 2, 6, 7}) {
    const auto expected = slow_bins(events, 100, 9000, bins);
    CHECK(worst(signed_bins(events.stream(), {100, 9000}, bins, kSize), expected) < 1e-3);
  }
}

TEST_CASE("voxelize: sums equal event counts times polarity inside the image", "[events]") {
  const auto events = random_events(5000, 0, 6000, 2);
  const auto voxel = voxelize(events.stream(), {0, 6000}, 6, kSize);
  int64_t sum = 0;
  for (const int8_t p : events.p) sum += p;
  CHECK((voxel.values.to(torch::kFloat64) * voxel.v_max).sum().item<double>() ==
        Approx(double(sum)).epsilon(1e-6));
  CHECK(voxel.values.abs().max().item<float>() == 1.0f);
  const auto counts = count_events(events.stream(), {0, 6000}, kSize);
  CHECK(counts.sum().item<int64_t>() == int64_t(5000) << 30);  // to the last bit
}

TEST_CASE("voxelize: an event on a knot belongs to the later bin alone", "[events]") {
  for (const int64_t duration : {6, 600, 601, 1000003}) {
    for (int64_t k = 0; k < 6; ++k) {
      const int64_t t = 50 + (duration * k + 5) / 6;  // first whole µs at or after knot k
      const auto events = EventStream::from_lists({4}, {5}, {t}, {1});
      const auto bins = signed_bins(events, {50, 50 + duration}, 6, kSize);
      CHECK(bins.sum().item<float>() == 1.0f);
      CHECK(bins[k][5][4].item<float>() == 1.0f);
    }
  }
  const auto last = EventStream::from_lists({4}, {5}, {650}, {1});
  CHECK(signed_bins(last, {50, 650}, 6, kSize).abs().sum().item<float>() == 0.0f);
}

TEST_CASE("voxelize: a window without events gives zeros", "[events]") {
  const auto voxel = voxelize(EventStream(), {0, 1000}, 6, kSize);
  CHECK(voxel.v_max == 0);
  CHECK(voxel.values.abs().max().item<float>() == 0.0f);
  CHECK(voxel.values.sizes() == torch::IntArrayRef({6, kSize.height, kSize.width}));
  CHECK(voxelize(EventStream(), {5, 5}, 6, kSize).v_max == 0);
}

TEST_CASE("count events: NaN, infinite and far coordinates touch nothing", "[events]") {
  const float nan = std::nanf(""), inf = INFINITY;
  const std::vector<float> x{nan, 1, inf, -inf, 1e30f, -1, 17, 3, 3},
      y{1, nan, 1, 1, 1, 2, 2, 13, -1};
  const auto events =
      EventStream::from_lists(x, y, std::vector<int64_t>(9, 0), std::vector<int8_t>(9, 1));
  CHECK(count_events(events, {0, 1}, kSize).abs().sum().item<int64_t>() == 0);
}

TEST_CASE("count events: weights on the image are kept for events that overlap its edge",
          "[events]") {
  const auto events = EventStream::from_lists({-0.25f, 16.5f}, {3, 12.5f}, {0, 0}, {1, 1});
  const auto density = event_density(events, kSize);
  CHECK(density[3][0].item<float>() == 0.75f);
  CHECK(density[12][16].item<float>() == 0.25f);
  CHECK(density.sum().item<float>() == 1.0f);
}

TEST_CASE("signed count: positive less negative events at every pixel", "[events]") {
  const auto events = random_events(500, 1.5f, 1000, 6);
  const auto expected = slow_bins(events, 0, 1000, 1)[0];
  const auto found = signed_count(events.stream(), kSize);
  CHECK(found.scalar_type() == torch::kFloat32);
  CHECK(worst(found, expected) < 1e-4);
  CHECK(found.min().item<float>() < 0);
  CHECK(signed_count(EventStream(), kSize).eq(0).all().item<bool>());
}

TEST_CASE("count events: the same bits for any number of threads and order of equal times",
          "[events]") {
  auto events = random_events(400000, 1.5f, 1000, 3);
  const std::vector<int64_t> knots{0, 10, 400, 401, 1000};
  const int threads = at::get_num_threads();
  at::set_num_threads(1);
  const auto one = count_events(events.stream(), knots, kSize);
  for (const int n : {2, 3, 7}) {
    at::set_num_threads(n);
    CHECK(torch::equal(count_events(events.stream(), knots, kSize), one));
  }
  at::set_num_threads(threads);
  for (size_t i = 0; i + 1 < events.t.size(); i += 2) {
    if (events.t[i] != events.t[i + 1]) continue;
    std::swap(events.x[i], events.x[i + 1]);
    std::swap(events.y[i], events.y[i + 1]);
    std::swap(events.p[i], events.p[i + 1]);
  }
  CHECK(torch::equal(count_events(events.stream(), knots, kSize), one));
}

TEST_CASE("map exposure: one pass gives what the separate functions give", "[events]") {
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

TEST_CASE("projection: positive and negative bins are summed apart", "[events]") {
  const auto voxel = torch::tensor({1.0, -2.0, 3.0, -0.5}).view({4, 1, 1});
  const auto projected = polarity_projection(voxel).flatten();
  CHECK(projected[0].item<float>() == Approx(4.0));
  CHECK(projected[1].item<float>() == Approx(2.5));
}

TEST_CASE("count events: a GPU gives the CPU's bits", "[events][cuda]") {
  const auto events = random_events(200000, 1.5f, 100000, 6).stream();
  std::vector<int64_t> knots;
  for (int64_t k = 0; k <= 100; ++k) knots.push_back(k * 997);  // more spans than one launch takes
  const auto on_gpu = count_events(events.to(torch::kCUDA), knots, kSize);
  CHECK(torch::equal(on_gpu.cpu(), count_events(events, knots, kSize)));
  const auto maps = map_exposure(events.to(torch::kCUDA), {5, 99999}, 6, kSize);
  CHECK(torch::equal(maps.voxel.values.cpu(),
                     map_exposure(events, {5, 99999}, 6, kSize).voxel.values));
  CHECK(count_events(EventStream().to(torch::kCUDA), knots, kSize).abs().sum().item<int64_t>() ==
        0);
}
