// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/terms.h"

#include "loss_cases.h"

namespace jade::losses {
namespace {

using test::check_gradients;
using test::image;

torch::Tensor flat(double value) { return torch::full({3, 4, 4}, value, torch::kFloat64); }
torch::Tensor factor(double value) { return torch::full({1, 4, 4}, value, torch::kFloat64); }

torch::Tensor rec(const imaging::L1SsimPair& pair, double dssim = 0.3) {
  return imaging::l1_ssim(pair.a, pair.c, dssim);
}
double l1(const imaging::L1SsimPair& pair) { return rec(pair, 0).item<double>(); }

TEST_CASE("terms: each term compares what it should, by hand with λ = 0", "[losses]") {
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

TEST_CASE("terms: gradients equal central differences", "[losses]") {
  const torch::Tensor r = image(9, {1, 7, 9}) + 0.5;
  using In = const std::vector<torch::Tensor>&;
  check_gradients(
      [](In in) {
        return rec(blur_pair(in[0], {in[1], {}, {}}));
      },
      {image(1), image(2)}, {"mean render", "blurry"});
  check_gradients([&](In in) { return rec(edi_gray_pair(in[0], in[1], r)); }, {image(1), image(2)},
                  {"render", "blurry"});
  check_gradients([&](In in) { return rec(edi_color_pair(in[0], image(2), r)); }, {image(1)},
                  {"render"});
  check_gradients([&](In in) { return rec(simulation_pair(in[0], in[1], r)); },
                  {image(1), image(2)}, {"render", "mean"});
  check_gradients([](In in) { return rec(intensity_pair(in[0], in[1])); }, {image(1), image(2)},
                  {"mean", "blurry"});
}

TEST_CASE("l_rec: equal images cost nothing, λ mixes L1 and SSIM", "[losses]") {
  const torch::Tensor a = image(1, {3, 20, 20}), b = image(2, {3, 20, 20});
  CHECK(imaging::l1_ssim(a, a, 0.3).item<double>() == Approx(0).margin(1e-12));
  const double l1 = (a - b).abs().mean().item<double>();
  const double zero = imaging::l1_ssim(a, b, 0).item<double>(),
               one = imaging::l1_ssim(a, b, 1).item<double>();
  CHECK(zero == Approx(l1));
  CHECK(imaging::l1_ssim(a, b, 0.3).item<double>() == Approx(0.7 * zero + 0.3 * one));
  CHECK(one > 0);
}

TEST_CASE("l_rec: gradients equal central differences on both sides", "[losses]") {
  check_gradients(
      [](const std::vector<torch::Tensor>& in) { return imaging::l1_ssim(in[0], in[1], 0.3); },
      {image(1), image(2)}, {"a", "c"});
}

TEST_CASE("target_loss: is the colour term plus the gray term, Eq. (9)", "[losses]") {
  // With λ = 0: mean |difference| of the colours, plus the luma difference.
  torch::Tensor render = flat(0.5), target = flat(0.5);
  target[1].fill_(0.6);
  const double expected = 0.1 / 3 + 0.587 * 0.1;
  CHECK(target_loss(render, Fixed(target), 0).item<double>() == Approx(expected));
  torch::Tensor wanted = target.clone().set_requires_grad(true);
  render.set_requires_grad(true);
  target_loss(render, Fixed(wanted), 0.3).backward();
  CHECK(render.grad().defined());
  CHECK_FALSE(wanted.grad().defined());
}

TEST_CASE("target_loss: gradients equal central differences", "[losses]") {
  const Fixed target(image(2));
  check_gradients(
      [&](const std::vector<torch::Tensor>& in) { return target_loss(in[0], target, 0.3); },
      {image(1)}, {"render"});
}

TEST_CASE("where_agreed: below the bound the value with its gradient, from it on 0 without",
          "[losses]") {
  for (const double distance : {0.049, 0.05}) {
    torch::Tensor value = torch::tensor(distance, torch::kFloat64).set_requires_grad(true);
    const torch::Tensor kept = where_agreed(value, 0.05);
    kept.backward();
    const bool agrees = distance < 0.05;
    CHECK(kept.item<double>() == (agrees ? distance : 0));
    CHECK(value.grad().item<double>() == (agrees ? 1 : 0));
  }
}

}  // namespace
}  // namespace jade::losses
