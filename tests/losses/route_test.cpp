// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/route.h"

#include "jade/losses/rec.h"
#include "jade/losses/target.h"
#include "jade/restore/restorations.h"
#include "loss_cases.h"

namespace jade::losses {
namespace {

using test::check_gradients;
using test::image;

torch::Tensor even(double value) { return torch::full({3, 5, 5}, value, torch::kFloat64); }
torch::Tensor even_kernel(double value) { return torch::full({1, 5, 5}, value, torch::kFloat64); }

TEST_CASE("route_loss: is the sum of both mean absolute differences", "[losses]") {
  const RouteLoss loss = route_loss(even(0.5), Fixed(even(0.8)), even_kernel(1.5), even(0.7), {});
  CHECK(loss.render.item<double>() == Approx(0.3));
  CHECK(loss.reblur.item<double>() == Approx(0.05));
  CHECK(loss.total.item<double>() == Approx(0.35));
}

TEST_CASE("route_loss: the reblur term counts with its weight", "[losses]") {
  RouteOptions options;
  options.reblur_weight = 0.1;
  const RouteLoss loss =
      route_loss(even(0.5), Fixed(even(0.8)), even_kernel(1.5), even(0.7), options);
  CHECK(loss.total.item<double>() == Approx(0.305));
}

TEST_CASE("route_loss: a term that is off is absent", "[losses]") {
  RouteOptions options;
  options.render_consistency = false;
  RouteLoss loss = route_loss(even(0.5), Fixed(even(0.8)), even_kernel(1.5), even(0.7), options);
  CHECK_FALSE(loss.render.defined());
  CHECK(loss.total.item<double>() == Approx(0.05));
  options.reblur_consistency = false;
  loss = route_loss(even(0.5), Fixed(even(0.8)), even_kernel(1.5), even(0.7), options);
  CHECK_FALSE(loss.total.defined());
}

TEST_CASE("route_loss: the render gets no gradient", "[losses]") {
  torch::Tensor pseudo = even(0.5).set_requires_grad(true);
  torch::Tensor render = even(0.8).set_requires_grad(true);
  route_loss(pseudo, Fixed(render), even_kernel(1.5), even(0.7), {}).total.backward();
  CHECK(pseudo.grad().defined());
  CHECK_FALSE(render.grad().defined());
}

TEST_CASE("route_loss: gradients equal central differences", "[losses]") {
  const Fixed render(image(2));
  check_gradients(
      [&](const std::vector<torch::Tensor>& in) {
        return route_loss(in[0], render, image(3, {1, 7, 9}) + 0.5, image(4), {}).total;
      },
      {image(1)}, {"pseudo"});
}

TEST_CASE("route_loss: where I_edi = F the gradient to α is zero, Eq. (5)", "[losses]") {
  torch::Tensor alpha = image(1, {1, 5, 5}).set_requires_grad(true);
  const restore::Restorations same{image(2, {3, 5, 5}), image(2, {3, 5, 5})};
  route_loss(restore::fuse(alpha, same), Fixed(even(0.8)), even_kernel(1.5), even(0.7), {})
      .total.backward();
  CHECK(alpha.grad().abs().max().item<double>() == 0);
}

TEST_CASE("route_loss: the reblur residual of the mix is the mix of residuals", "[losses]") {
  // Eq. (7) is linear in the image; with one-signed residuals so is its mean absolute value.
  RouteOptions options;
  options.render_consistency = false;
  const auto residual = [&](const torch::Tensor& pseudo) {
    return route_loss(pseudo, Fixed(pseudo), even_kernel(2), even(0.1), options)
        .total.item<double>();
  };
  const restore::Restorations r{even(0.9), even(0.4)};
  const double mix = residual(restore::fuse(even_kernel(0.25), r));
  CHECK(mix == Approx(0.25 * residual(r.edi) + 0.75 * residual(r.efnet)));
}

TEST_CASE("rec_loss: equal images cost nothing, λ mixes L1 and SSIM", "[losses]") {
  const torch::Tensor a = image(1, {3, 20, 20}), b = image(2, {3, 20, 20});
  CHECK(rec_loss(a, a, 0.3).item<double>() == Approx(0).margin(1e-12));
  const double l1 = (a - b).abs().mean().item<double>();
  const double zero = rec_loss(a, b, 0).item<double>(), one = rec_loss(a, b, 1).item<double>();
  CHECK(zero == Approx(l1));
  CHECK(rec_loss(a, b, 0.3).item<double>() == Approx(0.7 * zero + 0.3 * one));
  CHECK(one > 0);
}

TEST_CASE("rec_loss: gradients equal central differences on both sides", "[losses]") {
  check_gradients([](const std::vector<torch::Tensor>& in) { return rec_loss(in[0], in[1], 0.3); },
                  {image(1), image(2)}, {"a", "c"});
}

TEST_CASE("target_loss: is the colour term plus the gray term, Eq. (9)", "[losses]") {
  // With λ = 0: mean |difference| of the colours, plus the luma difference.
  torch::Tensor render = even(0.5), target = even(0.5);
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

}  // namespace
}  // namespace jade::losses
