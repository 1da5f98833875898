// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/route.h"

#include "jade/core/error.h"
#include "jade/restore/restorations.h"
#include "loss_cases.h"

namespace jade::losses {
namespace {

using test::check_gradients;
using test::image;

torch::Tensor even(double value) { return torch::full({3, 5, 5}, value, torch::kFloat64); }
torch::Tensor even_kernel(double value) { return torch::full({1, 5, 5}, value, torch::kFloat64); }

/// Restorations whose mix is `value` for any α.
restore::Restorations agreed(double value) { return {even(value), even(value)}; }

TEST_CASE("route_loss: is the sum of both mean absolute differences", "[losses]") {
  const restore::Restorations r{even(0.9), even(0.4)};  // their mix is 0.5
  const RouteLoss loss =
      route_loss(even_kernel(0.2), r, Fixed(even(0.8)), even_kernel(1.5), even(0.7), {});
  CHECK(loss.render.item<double>() == Approx(0.3));
  CHECK(loss.reblur.item<double>() == Approx(0.05));
  CHECK(loss.total.item<double>() == Approx(0.35));
}

TEST_CASE("route_loss: the reblur term counts with its weight", "[losses]") {
  RouteOptions options;
  options.reblur_weight = 0.1;
  const RouteLoss loss = route_loss(even_kernel(0.2), agreed(0.5), Fixed(even(0.8)),
                                    even_kernel(1.5), even(0.7), options);
  CHECK(loss.total.item<double>() == Approx(0.305));
}

TEST_CASE("route_loss: a term that is off is absent", "[losses]") {
  RouteOptions options;
  const auto loss_now = [&] {
    return route_loss(even_kernel(0.2), agreed(0.5), Fixed(even(0.8)), even_kernel(1.5), even(0.7),
                      options);
  };
  options.render_consistency = false;
  CHECK_FALSE(loss_now().render.defined());
  CHECK(loss_now().total.item<double>() == Approx(0.05));
  options.reblur_consistency = false;
  CHECK_FALSE(loss_now().total.defined());
  options.render_consistency = true;
  CHECK_FALSE(loss_now().reblur.defined());
  CHECK(loss_now().total.item<double>() == Approx(0.3));
}

TEST_CASE("route_loss: the render gets no gradient", "[losses]") {
  torch::Tensor alpha = even_kernel(0.2).set_requires_grad(true);
  torch::Tensor render = even(0.8).set_requires_grad(true);
  route_loss(alpha, {even(0.9), even(0.4)}, Fixed(render), even_kernel(1.5), even(0.7), {})
      .total.backward();
  CHECK(alpha.grad().defined());
  CHECK_FALSE(render.grad().defined());
}

TEST_CASE("route_loss: gradients equal central differences", "[losses]") {
  const Fixed render(image(2));
  const restore::Restorations r{image(5), image(6)};
  for (const auto& [with_render, with_reblur] :
       {std::pair{true, true}, {true, false}, {false, true}}) {
    RouteOptions options;
    options.render_consistency = with_render;
    options.reblur_consistency = with_reblur;
    options.reblur_weight = 0.3;
    check_gradients(
        [&](const std::vector<torch::Tensor>& in) {
          // A mean's gradient is small; scale it so that the check notices an error of a tenth.
          return 1e3 *
                 route_loss(in[0], r, render, image(3, {1, 7, 9}) + 0.5, image(4), options).total;
        },
        {image(1, {1, 7, 9})}, {"alpha"});
  }
}

/// An image that spans several parts of the sum and is no multiple of a block.
torch::Tensor large(uint64_t seed, int64_t channels = 3) {
  return image(seed, {channels, 137, 241});
}

/// The loss and its gradient by α, by torch's own operations if `plainly`.
std::pair<torch::Tensor, torch::Tensor> with_gradient(bool plainly, const torch::Device& device,
                                                      torch::ScalarType type) {
  const auto there = [&](const torch::Tensor& tensor) { return tensor.to(device, type); };
  RouteOptions options;
  options.reblur_weight = 0.3;
  const restore::Restorations r{there(large(5)), there(large(6))};
  const torch::Tensor kernel = there(large(3, 1) + 0.5), blurry = there(large(4));
  const Fixed render(there(large(2)));
  const torch::Tensor alpha = there(large(1, 1)).set_requires_grad(true);
  torch::Tensor value;
  if (plainly) {
    const torch::Tensor pseudo = restore::fuse(alpha, r);
    value = torch::l1_loss(pseudo, *render) + 0.3 * torch::l1_loss(pseudo * kernel, blurry);
  } else {
    value = route_loss(alpha, r, render, kernel, blurry, options).total;
  }
  value.backward();
  return {value.detach().cpu().to(torch::kFloat64), alpha.grad().cpu().to(torch::kFloat64)};
}

TEST_CASE("route_loss: equals the sum of torch's own mean absolute differences, gradient too",
          "[losses]") {
  const auto [expected, expected_gradient] = with_gradient(true, torch::kCPU, torch::kFloat64);
  const auto [found, gradient] = with_gradient(false, torch::kCPU, torch::kFloat64);
  CHECK(torch::allclose(found, expected, 1e-12, 0));
  CHECK(torch::allclose(gradient, expected_gradient, 1e-9, 1e-18));
}

TEST_CASE("route_loss: a GPU agrees with the CPU", "[losses][cuda]") {
  const auto [expected, expected_gradient] = with_gradient(false, torch::kCPU, torch::kFloat32);
  const auto [found, gradient] = with_gradient(false, {torch::kCUDA, 0}, torch::kFloat32);
  CHECK(torch::allclose(found, expected, 1e-5, 0));
  CHECK(torch::allclose(gradient, expected_gradient, 1e-4, 1e-11));
}

TEST_CASE("route_loss: one type for all", "[losses]") {
  CHECK_THROWS_AS(route_loss(even_kernel(0.2), agreed(0.5), Fixed(even(0.8).to(torch::kFloat32)),
                             even_kernel(1.5), even(0.7), {}),
                  ContractError);
}

TEST_CASE("route_loss: where I_edi = F the gradient to α is zero, Eq. (5)", "[losses]") {
  torch::Tensor alpha = image(1, {1, 5, 5}).set_requires_grad(true);
  const restore::Restorations same{image(2, {3, 5, 5}), image(2, {3, 5, 5})};
  route_loss(alpha, same, Fixed(even(0.8)), even_kernel(1.5), even(0.7), {}).total.backward();
  CHECK(alpha.grad().abs().max().item<double>() == 0);
}

TEST_CASE("route_loss: the reblur residual of the mix is the mix of residuals", "[losses]") {
  // Eq. (7) is linear in the image; with one-signed residuals so is its mean absolute value.
  RouteOptions options;
  options.render_consistency = false;
  const auto residual = [&](double alpha) {
    return route_loss(even_kernel(alpha), {even(0.9), even(0.4)}, Fixed(even(0)), even_kernel(2),
                      even(0.1), options)
        .total.item<double>();
  };
  CHECK(residual(0.25) == Approx(0.25 * residual(1) + 0.75 * residual(0)));
}

}  // namespace
}  // namespace jade::losses
