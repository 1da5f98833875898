// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/metrics.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"

using namespace jade;

namespace {

torch::Tensor random_image(int seed, int64_t height = 24, int64_t width = 30) {
  torch::manual_seed(seed);
  return torch::rand({3, height, width});
}

/// SSIM by its definition, one window at a time: an independent reference for the fused
/// implementation. Windows centred on excluded pixels do not count.
double slow_ssim(const torch::Tensor& a, const torch::Tensor& b, const torch::Tensor& mask = {}) {
  constexpr int kRadius = 5;
  double weights[11][11], total = 0;
  for (int i = -kRadius; i <= kRadius; ++i) {
    for (int j = -kRadius; j <= kRadius; ++j)
      total += weights[i + 5][j + 5] = std::exp(-(i * i + j * j) / (2 * 1.5 * 1.5));
  }
  double sum = 0, counted = 0;
  const auto x = a.accessor<float, 3>(), y = b.accessor<float, 3>();
  for (int64_t c = 0; c < a.size(0); ++c) {
    for (int64_t row = 0; row < a.size(1); ++row) {
      for (int64_t column = 0; column < a.size(2); ++column) {
        if (mask.defined() && !mask[0][row][column].item<bool>()) continue;
        ++counted;
        double mx = 0, my = 0, xx = 0, yy = 0, xy = 0;
        for (int i = -kRadius; i <= kRadius; ++i) {
          for (int j = -kRadius; j <= kRadius; ++j) {
            const int64_t r = row + i, q = column + j;
            if (r < 0 || q < 0 || r >= a.size(1) || q >= a.size(2)) continue;  // zero padding
            const double w = weights[i + 5][j + 5] / total, p = x[c][r][q], s = y[c][r][q];
            mx += w * p;
            my += w * s;
            xx += w * p * p;
            yy += w * s * s;
            xy += w * p * s;
          }
        }
        const double c1 = 1e-4, c2 = 9e-4;
        sum += (2 * mx * my + c1) * (2 * (xy - mx * my) + c2) /
               ((mx * mx + my * my + c1) * (xx - mx * mx + yy - my * my + c2));
      }
    }
  }
  return sum / counted;
}

}  // namespace

TEST_CASE("psnr: a uniform error of 0.1 is 20 dB both ways", "[eval]") {
  const auto truth = torch::full({3, 8, 9}, 0.5);
  CHECK(eval::psnr(truth + 0.1, truth) == Approx(20).margin(1e-4));
  CHECK(eval::psnr_channel_mean(truth + 0.1, truth) == Approx(20).margin(1e-4));
}

TEST_CASE("psnr: an image of NaN has none", "[eval]") {
  const torch::Tensor truth = torch::full({3, 8, 8}, 0.5);
  CHECK(std::isnan(eval::psnr(truth * std::nan(""), truth)));
  CHECK(std::isnan(eval::psnr_channel_mean(truth * std::nan(""), truth)));
}

TEST_CASE("psnr: the two definitions part where channels differ", "[eval]") {
  const auto truth = torch::full({3, 8, 9}, 0.5);
  auto image = truth.clone();
  image[0] += 0.1;
  image[1] += 0.01;
  image[2] += 0.01;
  // Channels: 20, 40, 40 dB. Global error: (0.01 + 2 · 0.0001) / 3.
  CHECK(eval::psnr_channel_mean(image, truth) == Approx(100.0 / 3).margin(1e-3));
  CHECK(eval::psnr(image, truth) == Approx(-10 * std::log10(0.0102 / 3)).margin(1e-3));
}

TEST_CASE("psnr: values outside [0,1] count as a screen shows them", "[eval]") {
  const auto truth = torch::ones({3, 4, 4});
  CHECK(eval::psnr(truth * 3, truth) == 100);
  CHECK_THROWS_AS(eval::psnr(truth, torch::ones({3, 4, 5})), ContractError);
}

TEST_CASE("ssim: equals its definition on images smaller and larger than the window", "[eval]") {
  for (const auto& [height, width] : {std::pair{24, 30}, {7, 9}, {1, 1}}) {
    const auto a = random_image(1, height, width),
               b = (a + 0.2 * random_image(2, height, width)).clamp(0, 1);
    CHECK(eval::ssim(a, b) == Approx(slow_ssim(a, b)).margin(1e-5));
    CHECK(eval::ssim(a, a) == Approx(1).margin(1e-5));
  }
}

TEST_CASE("ssim: of a render and of a truth, values outside [0,1] count as a screen shows them",
          "[eval]") {
  const auto wide = 3 * random_image(1) - 1, within = random_image(2);
  const double expected = slow_ssim(wide.clamp(0, 1), within);
  CHECK(std::abs(slow_ssim(wide, within) - expected) > 0.01);
  CHECK(eval::ssim(wide, within) == Approx(expected).margin(1e-5));
  CHECK(eval::ssim(within, wide) == Approx(expected).margin(1e-5));
}

TEST_CASE("ssim: excluded pixels are 0 in both images and have no share in the mean", "[eval]") {
  const auto a = random_image(1), b = (a + 0.5 * random_image(2)).clamp(0, 1);
  torch::Tensor mask = torch::zeros({1, 24, 30}, torch::kBool);
  mask.slice(1, 0, 8).slice(2, 3, 25).fill_(true);
  const double expected = slow_ssim(a * mask, b * mask, mask);
  CHECK(std::abs(expected - slow_ssim(a * mask, b * mask)) > 0.05);
  CHECK(eval::ssim(a, b, mask) == Approx(expected).margin(1e-5));
  CHECK(eval::ssim(a, b, torch::ones_like(mask)) == Approx(eval::ssim(a, b)).margin(1e-5));
}

TEST_CASE("metrics: excluded pixels change no score", "[eval]") {
  const torch::Tensor truth = random_image(1), image = (truth + 0.05 * random_image(2));
  torch::Tensor mask = torch::ones({1, 24, 30}, torch::kBool);
  mask.slice(2, 0, 9).fill_(false);
  torch::Tensor other = image.clone(), other_truth = truth.clone();
  other.slice(2, 0, 9).fill_(1);
  other_truth.slice(2, 0, 9).fill_(0.25);
  CHECK(eval::psnr(image, truth, mask) == eval::psnr(other, other_truth, mask));
  CHECK(eval::psnr_channel_mean(image, truth, mask) ==
        eval::psnr_channel_mean(other, other_truth, mask));
  CHECK(eval::ssim(image, truth, mask) == eval::ssim(other, other_truth, mask));
  CHECK(eval::psnr(image, truth, mask) ==
        Approx(eval::psnr(image.slice(2, 9).contiguous(), truth.slice(2, 9).contiguous())));
  CHECK(eval::psnr(image, truth, mask) != eval::psnr(image, truth));
  CHECK(eval::psnr(image, truth, torch::ones_like(mask)) == Approx(eval::psnr(image, truth)));
}
