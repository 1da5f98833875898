// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/reblur.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"

using namespace jade::imaging;
using jade::events::EventVoxel;
using jade::events::normalized;

TEST_CASE("reblur: an even log slope meets the closed form", "[imaging]") {
  // V_k = v: E_k − E_3 = v (k − 3) for k = 1 … 6.
  const EventVoxel voxel{torch::full({6, 2, 2}, 0.5, torch::kFloat64), 1};
  double expected = 0;
  for (int k = 1; k <= 6; ++k) expected += std::exp(0.7 * 0.5 * (k - 3)) / 6;
  CHECK(torch::allclose(reblur_kernel(voxel, 0.7),
                        torch::full({1, 2, 2}, expected, torch::kFloat64), 0, 1e-12));
}

TEST_CASE("reblur: samples are at the ends of the bins, with m the last before mid-exposure",
          "[imaging]") {
  for (int64_t k = 0; k < 6; ++k) {
    auto values = torch::zeros({6, 1, 1}, torch::kFloat64);
    values[k] = 1;
    // A step in bin k raises the samples k + 1 … 6, or lowers those before it when k < 3.
    const double samples = k < 3 ? (double(k) * std::exp(-1.0) + double(6 - k)) / 6
                                 : (double(k) + double(6 - k) * std::exp(1.0)) / 6;
    CHECK(reblur_kernel({values, 1}, 1.0).item<double>() == Approx(samples).epsilon(1e-12));
  }
}

TEST_CASE("reblur: about any moment K is the blur over the image of that moment", "[imaging]") {
  torch::manual_seed(3);
  const EventVoxel voxel = normalized(torch::randn({6, 2, 3}, torch::kFloat64));
  /// Σ of the bins before the place, the last one in part.
  const auto log_image = [&](double place) {
    auto sum = torch::zeros({2, 3}, torch::kFloat64);
    for (int64_t bin = 0; bin < 6; ++bin) {
      sum += voxel.values[bin] * std::clamp(place - double(bin), 0.0, 1.0);
    }
    return sum;
  };
  for (const double u : {0.0, 0.125, 0.3, 0.5, 1.0}) {
    INFO(u);
    auto blur = torch::zeros({2, 3}, torch::kFloat64);
    for (int k = 1; k <= 6; ++k) blur += (0.7 * log_image(k)).exp() / 6;
    CHECK(torch::allclose(reblur_kernel(voxel, 0.7, u)[0], blur / (0.7 * log_image(6 * u)).exp(), 0,
                          1e-12));
  }
  CHECK(reblur_kernel(voxel, 0.7, 0.5).equal(reblur_kernel(voxel, 0.7)));
  CHECK_THROWS_AS(reblur_kernel(voxel, 0.7, -0.1), jade::ContractError);
}

TEST_CASE("reblur: without events K is 1", "[imaging]") {
  CHECK(torch::equal(reblur_kernel(normalized(torch::zeros({6, 7, 9})), 1.0),
                     torch::ones({1, 7, 9})));
}

TEST_CASE("reblur: odd bins are refused", "[imaging]") {
  CHECK_THROWS_AS(reblur_kernel(normalized(torch::ones({5, 7, 9})), 1.0), jade::ContractError);
}
