// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/edi.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/geometry/trajectory.h"
#include "support/exposure_model.h"

using namespace jade;
using namespace jade::imaging;
using namespace jade::test;

namespace {

double worst(const torch::Tensor& a, const torch::Tensor& b) {
  return a.sub(b).abs().max().item<double>();
}

}  // namespace

TEST_CASE("edi: reblurring an EDI image gives back the frame, whatever the events", "[imaging]") {
  torch::manual_seed(1);
  const auto blurry = torch::rand({3, 7, 9}, torch::kFloat64);
  for (const double size : {0.0, 0.1, 1.0, 30.0, 400.0}) {
    const auto kernel = edi_kernel(torch::randn({8, 7, 9}, torch::kFloat64) * size);
    CHECK(kernel.gain.isfinite().all().item<bool>());
    if (size < 100)
      CHECK(worst(reblur_exposure(edi_at(blurry, kernel, geometry::kMidPose), kernel), blurry) <
            1e-9);
    CHECK(worst(edi_all(blurry, kernel).mean(0), blurry) < 1e-9);
    const auto single = edi_kernel(torch::randn({8, 7, 9}) * size);
    CHECK(worst(edi_all(blurry.to(torch::kFloat32), single).mean(0), blurry.to(torch::kFloat32)) <
          1e-4);
  }
}

TEST_CASE("edi: without events EDI returns the frame", "[imaging]") {
  const auto blurry = torch::rand({3, 7, 9});
  const auto kernel = edi_kernel(torch::zeros({8, 7, 9}));
  for (int64_t k = 0; k < geometry::kExposurePoses; ++k)
    CHECK(worst(edi_at(blurry, kernel, k), blurry) < 1e-6);
}

TEST_CASE("edi: an even log slope meets the closed form", "[imaging]") {
  // w_j = s: J_k = s (k − 4), and Σ exp(J_k) is sinh(4.5 s) / sinh(0.5 s).
  const double s = 0.2;
  const auto kernel = edi_kernel(torch::full({8, 2, 3}, s, torch::kFloat64));
  const double sum = std::sinh(4.5 * s) / std::sinh(0.5 * s);
  CHECK(kernel.blur[1][2].item<double>() == Approx(sum / 9).epsilon(1e-12));
  const auto blurry = torch::rand({1, 2, 3}, torch::kFloat64);
  for (int64_t k = 0; k < geometry::kExposurePoses; ++k) {
    const auto expected = blurry * (9 * std::exp(s * double(k - 4)) / sum);
    CHECK(worst(edi_at(blurry, kernel, k), expected) < 1e-12);
  }
}

TEST_CASE("edi: latent images follow the log increments between neighbours", "[imaging]") {
  const auto windows = torch::randn({8, 3, 4}, torch::kFloat64);
  const auto latent =
      edi_all(torch::rand({3, 3, 4}, torch::kFloat64) + 0.1, edi_kernel(windows)).log();
  for (int64_t j = 0; j < 8; ++j)
    CHECK(worst(latent[j + 1] - latent[j], windows[j].expand({3, -1, -1})) < 1e-10);
}

TEST_CASE("edi: by the trapezoid rule the ends of the integral count half", "[imaging]") {
  const auto windows = torch::randn({8, 3, 4}, torch::kFloat64);
  const auto kernel = edi_kernel(windows, geometry::QuadratureRule::kTrapezoid);
  auto weights = torch::full({9, 1, 1}, 1.0 / 8, torch::kFloat64);
  weights[0] = weights[8] = 1.0 / 16;
  CHECK(worst((kernel.gain * weights).sum(0), torch::ones({3, 4}, torch::kFloat64)) < 1e-12);
  CHECK(worst(kernel.gain[4] * kernel.blur, torch::ones({3, 4}, torch::kFloat64)) < 1e-12);
  // A linear increase of light is integrated exactly for any number of moments.
  const auto light = torch::linspace(1, 3, 33, torch::kFloat64);
  for (const int64_t step : {1, 4, 16}) {
    const auto knots = light.slice(0, 0, 33, step).log();
    const auto rise = (knots.slice(0, 1) - knots.slice(0, 0, -1)).view({-1, 1, 1});
    const auto mid = edi_kernel(rise, geometry::QuadratureRule::kTrapezoid).blur;
    CHECK(mid.item<double>() == Approx(1));
    CHECK(edi_kernel(rise).blur.item<double>() == Approx(1));
  }
}

TEST_CASE("edi: between its moments the gain is linear in log intensity", "[imaging]") {
  const auto windows = torch::randn({8, 3, 4}, torch::kFloat64);
  const auto kernel = edi_kernel(windows);
  const auto u = torch::tensor({0.0, 0.25, 0.3125, 1.0}, torch::kFloat64);
  const auto gain = edi_gain(windows, geometry::QuadratureRule::kEqual, u);
  CHECK(worst(gain[0], kernel.gain[0]) < 1e-12);
  CHECK(worst(gain[1], kernel.gain[2]) < 1e-12);
  CHECK(worst(gain[2], (kernel.gain[2] * kernel.gain[3]).sqrt()) < 1e-12);
  CHECK(worst(gain[3], kernel.gain[8]) < 1e-12);
}

TEST_CASE("edi: every pixel has its own gain, however many parts the image has", "[imaging]") {
  // A part on the CPU has 2,048 pixels of 64 float windows.
  const auto windows = torch::randn({64, 60, 71}), u = torch::tensor({0.1, 0.5}, torch::kFloat64);
  const auto rule = geometry::QuadratureRule::kTrapezoid;
  const auto all = edi_gain(windows, rule, u, 1.4);
  for (const int64_t row : {0, 30, 59}) {
    CHECK(
        torch::allclose(all.narrow(1, row, 1), edi_gain(windows.narrow(1, row, 1) * 1.4, rule, u)));
  }
}

TEST_CASE("edi: an odd number of windows is refused", "[imaging]") {
  CHECK_THROWS_AS(edi_kernel(torch::zeros({7, 3, 4})), jade::ContractError);
}
