// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/trust.h"

#include <cmath>

#include "jade/losses/rec.h"
#include "loss_cases.h"

namespace jade::losses {
namespace {

using test::image;

TEST_CASE(
    "trust: where target and render agree on average over 5x5, L1 keeps its gradient; a "
    "target far off abstains",
    "[losses]") {
  torch::Tensor render = torch::full({3, 24, 24}, 0.5, torch::kFloat64).set_requires_grad(true);
  torch::Tensor target = render.detach() + 0.01;
  target.narrow(1, 0, 8).add_(0.39);  // 0.4 off in the upper third
  const torch::Tensor drawn = trusted(target, Fixed(render), 0.04);
  (render - drawn).abs().sum().backward();
  CHECK(torch::allclose(render.grad(), torch::full_like(render, -1)));
  const auto share = [&](int64_t row) {
    return ((drawn - render) / (target - render))[0][row][12].item<double>();
  };
  CHECK(share(20) == Approx(0.04 / 0.05));
  CHECK(share(2) == Approx(0.04 / 0.44));
  CHECK(share(0) == Approx(0.04 / 0.44));  // the border's window is smaller, not darker
}

TEST_CASE("trust: closeness is 1 for equal images and a half where they differ by c", "[losses]") {
  const torch::Tensor a = image(1, {3, 12, 14}), same = closeness(a, a, 0.1);
  CHECK(same.equal(torch::ones({1, 12, 14}, torch::kFloat64)));
  torch::Tensor b = a.clone();
  b.narrow(2, 7, 7).sub_(0.1);
  const torch::Tensor close = closeness(a, b, 0.1);
  CHECK(close[0][6][12].item<double>() == Approx(0.5));
  CHECK(close[0][6][2].item<double>() == 1);
  CHECK(close[0][6][6].item<double>() == Approx(0.1 / (0.1 + 0.1 * 2 / 5)));
}

TEST_CASE("trust: the weight has no gradient, the target has its share", "[losses]") {
  torch::Tensor target = image(1).set_requires_grad(true);
  const torch::Tensor render = image(2);
  trusted(target, Fixed(render), 0.1).sum().backward();
  const torch::Tensor weight = (trusted(target, Fixed(render), 0.1) - render) / (target - render);
  CHECK(torch::allclose(target.grad(), weight.detach()));
}

TEST_CASE(
    "trust: inside the band a render has neither loss nor gradient, outside it the nearest "
    "end draws",
    "[losses]") {
  const torch::Tensor target = torch::full({1, 2, 3}, 0.4, torch::kFloat64);
  torch::Tensor render = torch::tensor({0.3, 0.39, 0.42, 0.5, 0.4, 0.6}, torch::kFloat64)
                             .view({1, 2, 3})
                             .set_requires_grad(true);
  const torch::Tensor drawn = within_band(target, Fixed(render), 0.1);
  (render - drawn).abs().sum().backward();
  const torch::Tensor expected =
      torch::tensor({-1., 0., 0., 1., 0., 1.}, torch::kFloat64).view({1, 2, 3});
  CHECK(render.grad().equal(expected));
  CHECK(drawn[0][0][0].item<double>() == Approx(0.4 * std::exp(-0.1)));
  CHECK(drawn[0][1][0].item<double>() == Approx(0.4 * std::exp(0.1)));
  CHECK(drawn[0][0][1].item<double>() == 0.39);
}

TEST_CASE("trust: both act only as far as they are asked for", "[losses]") {
  const torch::Tensor target = image(1), render = image(2);
  TrustOptions options;
  CHECK(followed(target, render, options, 0.25).equal(target));
  options.tolerance = 0.5;
  CHECK(followed(target, render, options, 0).equal(target));
  CHECK(followed(target, render, options, 0.2).equal(within_band(target, Fixed(render), 0.1)));
  options.scale = 0.1;
  CHECK(followed(target, render, options, 0).equal(trusted(target, Fixed(render), 0.1)));
}

}  // namespace
}  // namespace jade::losses
