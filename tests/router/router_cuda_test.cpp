// SPDX-License-Identifier: Apache-2.0
// The router's CUDA kernels against torch's own convolutions in float64 on the CPU, with the same
// rounding.
#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/router/router.h"
#include "support/router_reference.h"

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
Passed pass(Router& router, const torch::Tensor& input, const torch::Tensor& cotangent,
            const Forward& forward) {
  router->zero_grad();
  const torch::Tensor leaf = input.detach().clone().set_requires_grad(true);
  Passed out;
  out.logits = forward(leaf);
  out.logits.backward(cotangent);
  for (const torch::Tensor& parameter : router->parameters()) {
    out.gradients.push_back(parameter.grad().clone());
  }
  out.gradients.push_back(leaf.grad().narrow(1, 0, 3));
  out.gradients.push_back(leaf.grad().narrow(1, 3, 2));
  out.logits = out.logits.detach();
  return out;
}

RouterWeights weights_of(Router& router) {
  return {router->event1->weight, router->event2->weight, router->image1->weight,
          router->image1->bias,   router->image2->weight, router->image2->bias,
          router->head1->weight,  router->head2->weight,  router->head3->weight,
          router->head3->bias};
}

TEST_CASE("router: CUDA values and gradients equal rounded convolutions, for any size and batch",
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
    for (size_t i = 0; i < exact->parameters().size(); ++i) {
      const torch::NoGradGuard guard;
      const torch::Tensor values = whole(-1, 1, exact->parameters()[i].sizes().vec());
      exact->parameters()[i].copy_(values);
      router->parameters()[i].copy_(values);
    }
    const torch::Tensor input = whole(0, 3, {size[0], 5, size[1], size[2]});
    const torch::Tensor cotangent = whole(-3, 3, {size[0], 1, size[1], size[2]});
    const Passed expected =
        pass(exact, input.to(torch::kFloat64), cotangent.to(torch::kFloat64),
             [&](const torch::Tensor& x) { return rounded_logits(x, weights_of(exact)); });
    const auto on_gpu = [&](const torch::Tensor& x) { return router->logits(x); };
    const Passed found = pass(router, input.cuda(), cotangent.cuda(), on_gpu);
    const Passed again = pass(router, input.cuda(), cotangent.cuda(), on_gpu);
    INFO(size[0] << "x" << size[1] << "x" << size[2]);
    CHECK(excess(found.logits, expected.logits) < 2.5e-7);
    for (size_t i = 0; i < expected.gradients.size(); ++i) {
      INFO("gradient " << i);
      CHECK(excess(found.gradients[i], expected.gradients[i]) < 1e-6);
      CHECK(found.gradients[i].equal(again.gradients[i]));
    }
  }
}

TEST_CASE("router: a batch beyond CUDA's grid is a DeviceError", "[router][cuda]") {
  Router router(make_generator(3, "router"));
  router->to(torch::kCUDA);
  const auto logits = [&](int64_t batch) {
    return router->logits(torch::zeros({batch, 5, 1, 1}, torch::TensorOptions(torch::kCUDA)));
  };
  CHECK_NOTHROW(logits(2));
  CHECK_THROWS_AS(logits(70000), DeviceError);
}

}  // namespace
}  // namespace jade::router
