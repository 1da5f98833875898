// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/metrics.h"

#include "support/catch.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/eval/report.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

torch::Tensor random_image(int seed, int64_t height = 24, int64_t width = 30) {
  torch::manual_seed(seed);
  return torch::rand({3, height, width});
}

/// SSIM by its definition, one window at a time: a second implementation to hold the fused one
/// against.
double slow_ssim(const torch::Tensor& a, const torch::Tensor& b) {
  constexpr int kRadius = 5;
  double weights[11][11], total = 0;
  for (int i = -kRadius; i <= kRadius; ++i) {
    for (int j = -kRadius; j <= kRadius; ++j)
      total += weights[i + 5][j + 5] = std::exp(-(i * i + j * j) / (2 * 1.5 * 1.5));
  }
  double sum = 0;
  const auto x = a.accessor<float, 3>(), y = b.accessor<float, 3>();
  for (int64_t c = 0; c < a.size(0); ++c) {
    for (int64_t row = 0; row < a.size(1); ++row) {
      for (int64_t column = 0; column < a.size(2); ++column) {
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
  return sum / static_cast<double>(a.numel());
}

}  // namespace

TEST_CASE("psnr: a uniform error of 0.1 is 20 dB both ways", "[eval]") {
  const auto truth = torch::full({3, 8, 9}, 0.5);
  CHECK(eval::psnr(truth + 0.1, truth) == Approx(20).margin(1e-4));
  CHECK(eval::psnr_channel_mean(truth + 0.1, truth) == Approx(20).margin(1e-4));
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

TEST_CASE("evaluation: JSON holds every view, the mean and null for metrics without their network",
          "[eval]") {
  const auto truth = random_image(3);
  const auto evaluation = eval::evaluation_of(
      {eval::score("a", (truth + 0.1).clamp(0, 1), truth), eval::score("b", truth, truth)});
  const auto json = nlohmann::json::parse(eval::to_json(evaluation));
  CHECK(json["views"].size() == 2);
  CHECK(json["mean"]["psnr"] == Approx((evaluation.views[0].psnr + 100) / 2));
  CHECK(json["mean"]["lpips_alex01"].is_null());
}

TEST_CASE("evaluation: the table says how to get LPIPS wherever it shows '-'", "[eval]") {
  const auto table = [](std::optional<double> alex, std::optional<double> vgg) {
    return eval::to_table(eval::evaluation_of({{"a", 30, 30, 0.9, alex, vgg}}));
  };
  const auto hint = Catch::Contains("scripts/setup.sh --metrics");
  CHECK_THAT(table({}, {}), hint);
  CHECK_THAT(table(0.1, {}), hint);
  CHECK_THAT(table(0.1, 0.2), !hint);
}

TEST_CASE("evaluation: views that training has seen have a mean of their own", "[eval]") {
  std::vector<eval::Scores> views(4);
  const std::optional<bool> marks[] = {true, false, false, std::nullopt};
  for (size_t i = 0; i < 4; ++i) {
    views[i].name = std::string(1, static_cast<char>('a' + i));
    views[i].psnr = 20 + 2.0 * static_cast<double>(i);
    views[i].ssim = 0.5 + 0.1 * static_cast<double>(i);
    views[i].seen = marks[i];
  }
  views[1].lpips_vgg = 0.3, views[2].lpips_vgg = 0.5;
  const eval::Evaluation evaluation = eval::evaluation_of(views);
  const auto json = nlohmann::json::parse(eval::to_json(evaluation));
  CHECK(json["views"][0]["seen"] == true);
  CHECK(json["views"][1]["seen"] == false);
  CHECK(json["views"][3]["seen"].is_null());
  CHECK(json["mean"]["psnr"] == Approx(23));
  CHECK(json["mean_seen"]["psnr"] == Approx(20));
  CHECK(json["mean_seen"]["lpips_vgg"].is_null());
  CHECK(json["mean_unseen"]["psnr"] == Approx(23));
  CHECK(json["mean_unseen"]["ssim"] == Approx(0.65));
  CHECK(json["mean_unseen"]["lpips_vgg"] == Approx(0.4));
  for (const char* mean : {"mean_seen", "mean_unseen"}) {
    for (const auto& [key, value] : json["mean"].items()) CHECK(json[mean].contains(key));
    CHECK(json[mean].size() == json["mean"].size());
  }
  const std::string table = eval::to_table(evaluation);
  INFO(table);
  for (const char* line :
       {"a (seen) ", "b (unseen) ", "\nd  ", "mean of seen ", "mean of unseen "}) {
    CHECK_THAT(table, Catch::Contains(line));
  }
  for (eval::Scores& view : views) view.seen.reset();
  const auto unknown = nlohmann::json::parse(eval::to_json(eval::evaluation_of(views)));
  CHECK((unknown["mean_seen"].is_null() && unknown["mean_unseen"].is_null()));
  CHECK_THAT(eval::to_table(eval::evaluation_of(views)), !Catch::Contains("seen"));
}

TEST_CASE("lpips: without its modules, or with a broken one, the metric is absent", "[eval]") {
  const test::TempDir dir;
  dir.write("lpips_vgg.pt", "not a module");
  const eval::Lpips lpips(torch::kCPU, dir.path());
  const auto image = random_image(4, 64, 64);
  CHECK_FALSE(lpips.alex01(image, image).has_value());
  CHECK_FALSE(lpips.vgg(image, image).has_value());
}
