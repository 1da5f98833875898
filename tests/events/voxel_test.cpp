// SPDX-License-Identifier: Apache-2.0
#include "jade/events/voxel.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "random_events.h"
#include "support/signed_bins.h"

using namespace jade::events;
using namespace jade::test;

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

TEST_CASE("voxelize: the largest magnitude becomes one, whatever its sign", "[events]") {
  const auto events =
      EventStream::from_lists({2, 2, 2, 5}, {3, 3, 3, 4}, {10, 20, 30, 40}, {-1, -1, -1, 1});
  const auto voxel = voxelize(events, {0, 100}, 1, kSize);
  CHECK(voxel.v_max == Approx(3));
  CHECK(voxel.values.min().item<float>() == Approx(-1));
  CHECK(voxel.values.max().item<float>() == Approx(1.0 / 3));
}

TEST_CASE("voxelize: a window without events gives zeros", "[events]") {
  const auto voxel = voxelize(EventStream(), {0, 1000}, 6, kSize);
  CHECK(voxel.v_max == 0);
  CHECK(voxel.values.abs().max().item<float>() == 0.0f);
  CHECK(voxel.values.sizes() == torch::IntArrayRef({6, kSize.height, kSize.width}));
  CHECK(voxelize(EventStream(), {5, 5}, 6, kSize).v_max == 0);
}

TEST_CASE("projection: about a moment each event counts with its side's share of the blur",
          "[events]") {
  torch::manual_seed(2);
  const auto voxel = torch::randn({6, 3, 4}, torch::kFloat64);
  constexpr int kFine = 1200;  // slices per bin, so that every moment below falls between two
  for (const double u : {0.0, 0.125, 0.25, 0.5, 0.8, 1.0}) {
    INFO(u);
    auto expected = torch::zeros({2, 3, 4}, torch::kFloat64);
    for (int64_t bin = 0; bin < 6; ++bin) {
      double share = 0;
      for (int slice = 0; slice < kFine; ++slice) {
        const double tau = (double(bin) + (slice + 0.5) / kFine) / 6;
        share += (tau < u ? 2 * u : 2 * (1 - u)) / kFine;
      }
      expected[0] += share * voxel[bin].clamp_min(0);
      expected[1] += share * (-voxel[bin]).clamp_min(0);
    }
    CHECK(torch::allclose(polarity_projection(voxel, u), expected, 0, 1e-12));
  }
  CHECK(polarity_projection(voxel, 0.5).equal(polarity_projection(voxel)));
  CHECK(polarity_projection(voxel, 1).equal(2 * polarity_projection(voxel)));
  CHECK_THROWS_AS(polarity_projection(voxel, 1.1), jade::ContractError);
}

TEST_CASE("projection: positive and negative bins are summed apart", "[events]") {
  const auto voxel = torch::tensor({1.0, -2.0, 3.0, -0.5}).view({4, 1, 1});
  const auto projected = polarity_projection(voxel).flatten();
  CHECK(projected[0].item<float>() == Approx(4.0));
  CHECK(projected[1].item<float>() == Approx(2.5));
}
