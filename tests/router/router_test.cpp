// SPDX-License-Identifier: Apache-2.0
#include "jade/router/router.h"

#include "support/catch.h"

#include <cmath>

#include "jade/core/error.h"
#include "jade/core/random.h"

namespace jade::router {
namespace {

int64_t count(const std::vector<torch::nn::Conv2d>& layers) {
  int64_t sum = 0;
  for (const auto& layer : layers) {
    for (const torch::Tensor& parameter : layer->parameters()) sum += parameter.numel();
  }
  return sum;
}

Router make_router(uint64_t seed = 0) { return Router(make_generator(seed, "router")); }

TEST_CASE("router: has the paper's 3,200 + 2,768 + 3,346 = 9,314 parameters", "[router]") {
  const Router router = make_router();
  CHECK(count({router->event1, router->event2}) == 3200);
  CHECK(count({router->image1, router->image2}) == 2768);
  CHECK(count({router->head1, router->head2, router->head3}) == 3346);
  int64_t all = 0;
  for (const torch::Tensor& parameter : router->parameters()) all += parameter.numel();
  CHECK(all == 9314);
}

TEST_CASE("router: first weights are uniform within 1/sqrt(fan-in)", "[router]") {
  const Router router = make_router();
  for (const auto& layer : {router->event1, router->event2, router->image1, router->image2,
                            router->head1, router->head2, router->head3}) {
    const torch::Tensor& weights = layer->weight;
    const double bound = 1 / std::sqrt(static_cast<double>(weights[0].numel()));
    INFO(weights.sizes());
    const double largest = weights.abs().max().item<double>();
    CHECK(largest <= bound);
    CHECK(largest > 0.85 * bound);
    if (layer->bias.defined()) CHECK(layer->bias.abs().max().item<double>() <= bound);
  }
}

TEST_CASE("router: one value per pixel, in [0,1], for any size and batch", "[router]") {
  Router router = make_router();
  for (const auto& size : std::vector<std::vector<int64_t>>{{1, 1, 1}, {2, 7, 5}, {1, 26, 34}}) {
    const torch::Tensor alpha = router(100 * torch::rand({size[0], 5, size[1], size[2]}));
    CHECK(alpha.sizes() == torch::IntArrayRef({size[0], 1, size[1], size[2]}));
    CHECK(alpha.min().item<double>() >= 0);
    CHECK(alpha.max().item<double>() <= 1);
  }
  CHECK_THROWS_AS(router(torch::rand({1, 3, 4, 4})), ContractError);
}

TEST_CASE("router: replicate padding leaves no frame on a constant input", "[router]") {
  Router router = make_router();
  const torch::Tensor values = torch::tensor({0.3f, 0.3f, 0.3f, 0.7f, 0.7f});
  const torch::Tensor alpha = router(values.view({1, 5, 1, 1}).expand({1, 5, 20, 20}));
  CHECK((alpha - alpha[0][0][10][10]).abs().max().item<double>() < 1e-6);
}

TEST_CASE("router: the seed decides the weights and nothing else does", "[router]") {
  torch::manual_seed(1);
  const Router a = make_router(5);
  torch::manual_seed(2);
  const Router b = make_router(5);
  const Router c = make_router(6);
  CHECK(torch::equal(a->event1->weight, b->event1->weight));
  CHECK(torch::equal(a->head3->bias, b->head3->bias));
  CHECK_FALSE(torch::equal(a->event1->weight, c->event1->weight));
}

TEST_CASE("router: both measurements reach α and every parameter gets a gradient", "[router]") {
  Router router = make_router();
  const torch::Tensor input = torch::rand({1, 5, 12, 12}).set_requires_grad(true);
  router(input).sum().backward();
  CHECK((input.grad().abs().sum({0, 2, 3}) > 0).all().item<bool>());
  for (const auto& parameter : router->named_parameters()) {
    INFO(parameter.key());
    CHECK(parameter.value().grad().defined());
  }
}

}  // namespace
}  // namespace jade::router
