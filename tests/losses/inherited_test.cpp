// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/inherited.h"

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

}  // namespace
}  // namespace jade::losses
