// SPDX-License-Identifier: Apache-2.0
#include "jade/models/allocation.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/models/restorations.h"

namespace jade::models {
namespace {

constexpr int64_t kViews = 3, kHeight = 6, kWidth = 8;

std::shared_ptr<Allocation> make(const std::string& kind, double constant = 0.5) {
  return make_allocation({kind, constant}, kViews, kHeight, kWidth, make_generator(0, "router"));
}

AllocationInput input(int64_t view = 0) {
  return {torch::rand({3, kHeight, kWidth}), torch::rand({2, kHeight, kWidth}), view};
}

TEST_CASE("allocation: every kind gives one value a pixel, in [0,1] but without the sigmoid",
          "[models]") {
  for (const std::string kind :
       {"router", "router_no_sigmoid", "constant", "global_scalar", "per_view_map"}) {
    const torch::Tensor alpha = make(kind)->forward(input(1));
    INFO(kind);
    CHECK(alpha.sizes() == torch::IntArrayRef({1, kHeight, kWidth}));
    if (kind != "router_no_sigmoid") {
      CHECK(alpha.min().item<double>() >= 0);
      CHECK(alpha.max().item<double>() <= 1);
    }
  }
}

TEST_CASE("allocation: each kind has the parameters it should have", "[models]") {
  const auto count = [](const std::string& kind) {
    int64_t sum = 0;
    for (const torch::Tensor& parameter : make(kind)->parameters()) sum += parameter.numel();
    return sum;
  };
  CHECK(count("router") == 9314);
  CHECK(count("router_no_sigmoid") == 9314);
  CHECK(count("constant") == 0);
  CHECK(count("global_scalar") == 1);
  CHECK(count("per_view_map") == kViews * kHeight * kWidth);
  CHECK(make("router")->trainable());
  CHECK_FALSE(make("constant")->trainable());
  CHECK(make("none") == nullptr);
  CHECK_THROWS_AS(make("oracle"), ConfigError);
}

TEST_CASE("allocation: the router without sigmoid is the same network, unbounded", "[models]") {
  const AllocationInput in = input();
  const torch::Tensor logits = make("router_no_sigmoid")->forward(in);
  CHECK(torch::allclose(make("router")->forward(in), logits.sigmoid()));
}

TEST_CASE("allocation: constants, learned numbers and maps start where they should", "[models]") {
  CHECK((make("constant", 0.25)->forward(input()) == 0.25).all().item<bool>());
  CHECK((make("global_scalar")->forward(input()) == 0.5).all().item<bool>());
  CHECK((make("per_view_map")->forward(input(2)) == 0.5).all().item<bool>());
  CHECK_THROWS_AS(make("per_view_map")->forward(input(kViews)), ContractError);
}

TEST_CASE("allocation: a per-view map learns its own view only", "[models]") {
  const auto allocation = make("per_view_map");
  allocation->forward(input(1)).sum().backward();
  const auto maps = allocation->parameters();
  REQUIRE(maps.size() == kViews);
  CHECK(maps[1].grad().abs().min().item<double>() > 0);
  CHECK_FALSE(maps[0].grad().defined());
  CHECK_FALSE(maps[2].grad().defined());
}

TEST_CASE("fuse: α = 1 takes EDI, α = 0 takes EFNet, between is the mix of Eq. (4)", "[models]") {
  const Restorations r{torch::tensor({0.75, 1.5, 0.25}).view({3, 1, 1}),
                       torch::tensor({0.25, 0.5, 0.25}).view({3, 1, 1})};
  const auto with = [&](double alpha) { return fuse(torch::full({1, 1, 1}, alpha), r).flatten(); };
  CHECK(torch::equal(with(1), r.edi.flatten()));
  CHECK(torch::equal(with(0), r.efnet.flatten()));
  CHECK(torch::allclose(with(0.25), torch::tensor({0.375, 0.75, 0.25})));
}

TEST_CASE("fuse: where both restorations agree the gradient to α is exactly zero, Eq. (5)",
          "[models]") {
  torch::Tensor edi = torch::rand({3, kHeight, kWidth});
  torch::Tensor efnet = edi.clone();
  efnet.slice(2, 0, 3) = torch::rand({3, kHeight, 3});
  torch::Tensor alpha = torch::rand({1, kHeight, kWidth}).set_requires_grad(true);
  const torch::Tensor cotangent = torch::rand({3, kHeight, kWidth});
  fuse(alpha, {edi, efnet}).backward(cotangent);
  CHECK(alpha.grad().slice(2, 3).abs().max().item<double>() == 0);
  const torch::Tensor expected = (cotangent * (edi - efnet)).sum(0, true);
  CHECK(torch::allclose(alpha.grad(), expected));
}

}  // namespace
}  // namespace jade::models
