// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/inherited.h"

#include <cmath>

#include "jade/losses/rec.h"
#include "loss_cases.h"

namespace jade::losses {
namespace {

using test::check_gradients;
using test::image;

torch::Tensor flat(double value) { return torch::full({3, 4, 4}, value, torch::kFloat64); }
torch::Tensor factor(double value) { return torch::full({1, 4, 4}, value, torch::kFloat64); }

double l1(const imaging::L1SsimPair& pair) { return rec_loss(pair, 0).item<double>(); }

TEST_CASE("inherited: each term compares what it should, by hand with λ = 0", "[losses]") {
  CHECK(l1(blur_pair(flat(0.5), {flat(0.7), {}, {}})) == Approx(0.2));
  CHECK(l1(blur_pair(flat(0.5), imaging::ssim_target(flat(0.7)))) == Approx(0.2));
  CHECK(l1(edi_gray_pair(flat(0.5), flat(0.4), factor(1.5))) == Approx(0.1));
  torch::Tensor render = flat(0.6);
  render[2].fill_(0.9);
  CHECK(l1(edi_color_pair(render, flat(0.4), factor(1.5))) == Approx(0.1));
  CHECK(l1(edi_gray_pair(render, flat(0.4), factor(1.5))) == Approx(0.114 * 0.3));
  CHECK(l1(simulation_pair(flat(0.5), flat(0.4), factor(0.5))) == Approx(0.3));
  CHECK(l1(intensity_pair(flat(0.5), flat(0.45))) == Approx(0.05));
}

TEST_CASE("inherited: gradients equal central differences", "[losses]") {
  const torch::Tensor r = image(9, {1, 7, 9}) + 0.5;
  using In = const std::vector<torch::Tensor>&;
  check_gradients(
      [](In in) {
        return rec_loss(blur_pair(in[0], {in[1], {}, {}}), 0.3);
      },
      {image(1), image(2)}, {"mean render", "blurry"});
  check_gradients([&](In in) { return rec_loss(edi_gray_pair(in[0], in[1], r), 0.3); },
                  {image(1), image(2)}, {"render", "blurry"});
  check_gradients([&](In in) { return rec_loss(edi_color_pair(in[0], image(2), r), 0.3); },
                  {image(1)}, {"render"});
  check_gradients([&](In in) { return rec_loss(simulation_pair(in[0], in[1], r), 0.3); },
                  {image(1), image(2)}, {"render", "mean"});
  check_gradients([](In in) { return rec_loss(intensity_pair(in[0], in[1]), 0.3); },
                  {image(1), image(2)}, {"mean", "blurry"});
}

TEST_CASE("lin_log: a line up to 20, the logarithm above, one function", "[losses]") {
  const torch::Tensor x = torch::tensor({0.0, 10.0, 20.0, 255.0}, torch::kFloat64);
  const torch::Tensor y = lin_log(x);
  CHECK(y[0].item<double>() == 0);
  CHECK(y[1].item<double>() == Approx(std::log(20.0) / 2));
  CHECK(y[2].item<double>() == Approx(std::log(20.0)));
  CHECK(y[3].item<double>() == Approx(std::log(255.0)));
  torch::Tensor dark = torch::zeros({1}, torch::kFloat64).set_requires_grad(true);
  lin_log(dark).sum().backward();
  CHECK(dark.grad().item<double>() == Approx(std::log(20.0) / 20));
}

/// Brightness doubles everywhere; two pixels brighter, one darker, the rest quiet.
EventPair doubling() {
  EventPair pair;
  pair.before = flat(0.3);
  pair.after = flat(0.6);
  pair.counts = torch::zeros({4, 4}, torch::kFloat64);
  pair.counts[0][0] = 3;
  pair.counts[1][2] = 5;
  pair.counts[3][3] = -2;
  pair.pixels = torch::arange(16, torch::kInt64);
  return pair;
}

TEST_CASE("event_loss: gray, by hand, with a threshold for each sign", "[losses]") {
  EventPair pair = doubling();
  pair.threshold_negative = 0.4;
  const double up = std::log(2.0) / 0.2, down = std::log(2.0) / 0.4;
  const double expected = (std::pow(up - 3, 2) + std::pow(up - 5, 2) + std::pow(down + 2, 2)) / 16;
  CHECK(event_loss(pair).item<double>() == Approx(expected));
}

TEST_CASE("event_loss: only drawn pixels count, and without events it is zero", "[losses]") {
  EventPair pair = doubling();
  pair.pixels = torch::tensor({0, 1}, torch::kInt64);
  CHECK(event_loss(pair).item<double>() == Approx(std::pow(std::log(2.0) / 0.2 - 3, 2) / 2));
  pair.counts.zero_();
  CHECK(event_loss(pair).item<double>() == 0);
}

TEST_CASE("event_loss: in colour a pixel's own channel counts, weighted after the warm-up",
          "[losses]") {
  EventPair pair = doubling();
  pair.before[1].fill_(0.6);  // green does not change
  pair.threshold_positive = pair.threshold_negative = 0.25;
  pair.color_filter = torch::zeros({4, 4, 3}, torch::kBool);
  pair.color_filter[0][0][0] = true;  // red, n = 3
  pair.color_filter[1][2][1] = true;  // green, n = 5
  const double red = std::pow(std::log(2.0) / 0.25 - 3, 2), green = 25;
  CHECK(event_loss(pair).item<double>() == Approx((red + green) / 2));
  pair.weighted_colors = true;
  CHECK(event_loss(pair).item<double>() == Approx((0.4 * red + 0.2 * green) / 0.6));
}

TEST_CASE("event_loss: gradients equal central differences", "[losses]") {
  for (const bool color : {false, true}) {
    EventPair pair;
    pair.counts = (image(5, {7, 9}) * 10 - 5).round();
    pair.pixels = torch::arange(0, 63, 2, torch::kInt64);
    if (color) pair.color_filter = image(6, {7, 9, 3}) > 0.5;
    pair.weighted_colors = color;
    check_gradients(
        [&](const std::vector<torch::Tensor>& in) {
          EventPair filled = pair;
          filled.before = in[0];
          filled.after = in[1];
          return event_loss(filled);
        },
        {image(1), image(2)}, {"before", "after"});
  }
}

}  // namespace
}  // namespace jade::losses
