// SPDX-License-Identifier: Apache-2.0
// The router's CUDA kernels against torch's own convolutions in float64 on the CPU.
#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/router/router.h"

namespace jade::router {
namespace {

double excess(const torch::Tensor& found, const torch::Tensor& expected) {
  const torch::Tensor difference = (found.cpu().to(torch::kFloat64) - expected).abs().max();
  return (difference / (expected.abs().max() + 1e-12)).item<double>();
}

struct Passed {
  torch::Tensor logits;
  std::vector<torch::Tensor> gradients;
};

template <class Forward>
Passed pass(Router& router, torch::Tensor blurry, torch::Tensor psi, const torch::Tensor& cotangent,
            const Forward& forward) {
  router->zero_grad();
  blurry = blurry.detach().clone().set_requires_grad(true);
  psi = psi.detach().clone().set_requires_grad(true);
  Passed out;
  out.logits = forward(blurry, psi);
  out.logits.backward(cotangent);
  for (const torch::Tensor& parameter : router->parameters()) {
    out.gradients.push_back(parameter.grad().clone());
  }
  out.gradients.push_back(blurry.grad());
  out.gradients.push_back(psi.grad());
  out.logits = out.logits.detach();
  return out;
}

/// 0 at pixels whose logit depends on a unit so near to ReLU's kink that rounding decides its side,
/// and with it its whole gradient; 1 elsewhere. [N,1,H,W]
torch::Tensor away_from_kinks(Router& router, const torch::Tensor& blurry,
                              const torch::Tensor& psi) {
  constexpr double kNear = 1e-5;
  torch::Tensor near = torch::zeros_like(blurry.slice(1, 0, 1));
  const auto unit = [&](torch::nn::Conv2d& layer, const torch::Tensor& in) {
    const torch::Tensor out = layer->forward(in);
    near = torch::maximum(near, (out.abs() < kNear).to(near.dtype()).amax(1, true));
    return out.relu();
  };
  const torch::NoGradGuard guard;
  const torch::Tensor events = unit(router->event2, unit(router->event1, psi));
  const torch::Tensor image = unit(router->image2, unit(router->image1, blurry));
  unit(router->head2, unit(router->head1, torch::cat({blurry, events, image}, 1)));
  constexpr int64_t kReach = 4;  // of the first layers' units: 5x5, 3x3, 3x3 follow
  return 1 - torch::max_pool2d(near, 2 * kReach + 1, 1, kReach);
}

TEST_CASE("router: CUDA values and gradients equal float64 convolutions, for any size and batch",
          "[router][cuda]") {
  torch::manual_seed(4);
  for (const auto& size : std::vector<std::vector<int64_t>>{{1, 1, 1},
                                                            {2, 3, 5},
                                                            {1, 8, 32},
                                                            {2, 9, 33},
                                                            {1, 5, 29},
                                                            {1, 61, 47},
                                                            {1, 260, 346},
                                                            {2, 200, 340}}) {
    Router exact(make_generator(3, "router")), router(make_generator(3, "router"));
    exact->to(torch::kFloat64);
    router->to(torch::kCUDA);
    const torch::Tensor blurry = torch::rand({size[0], 3, size[1], size[2]});
    const torch::Tensor psi = 2 * torch::rand({size[0], 2, size[1], size[2]});
    const torch::Tensor away =
        away_from_kinks(exact, blurry.to(torch::kFloat64), psi.to(torch::kFloat64));
    CHECK(away.mean().item<double>() > 0.2);
    const torch::Tensor cotangent =
        torch::randn({size[0], 1, size[1], size[2]}) * away.to(torch::kFloat32);
    const Passed expected = pass(
        exact, blurry.to(torch::kFloat64), psi.to(torch::kFloat64), cotangent.to(torch::kFloat64),
        [&](const auto& b, const auto& p) { return exact->logits_by_layers(b, p); });
    const auto on_gpu = [&](const auto& b, const auto& p) { return router->logits(b, p); };
    const Passed found = pass(router, blurry.cuda(), psi.cuda(), cotangent.cuda(), on_gpu);
    const Passed again = pass(router, blurry.cuda(), psi.cuda(), cotangent.cuda(), on_gpu);
    INFO(size[0] << "x" << size[1] << "x" << size[2]);
    CHECK(excess(found.logits, expected.logits) < 1e-5);
    for (size_t i = 0; i < expected.gradients.size(); ++i) {
      INFO("gradient " << i);
      CHECK(excess(found.gradients[i], expected.gradients[i]) < 1e-4);
      CHECK(found.gradients[i].equal(again.gradients[i]));
    }
  }
}

TEST_CASE("router: a batch beyond CUDA's grid is a DeviceError", "[router][cuda]") {
  Router router(make_generator(3, "router"));
  router->to(torch::kCUDA);
  const auto logits = [&](int64_t batch) {
    const auto zeros = [&](int64_t channels) {
      return torch::zeros({batch, channels, 1, 1}, torch::TensorOptions(torch::kCUDA));
    };
    return router->logits(zeros(3), zeros(2));
  };
  CHECK_NOTHROW(logits(2));
  CHECK_THROWS_AS(logits(70000), DeviceError);
}

}  // namespace
}  // namespace jade::router
