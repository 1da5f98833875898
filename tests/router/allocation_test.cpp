// SPDX-License-Identifier: Apache-2.0
#include "jade/router/allocation.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/restore/restorations.h"

namespace jade::router {
namespace {

constexpr int64_t kViews = 3, kHeight = 6, kWidth = 8;

std::shared_ptr<Allocation> make(const std::string& kind) {
  return make_allocation({value_of<AllocationKind>(kind).value()}, kViews, kHeight, kWidth,
                         make_generator(0, "router"));
}

torch::Tensor measured() { return torch::rand({5, kHeight, kWidth}); }

TEST_CASE("allocation: every kind gives one value per pixel, in [0,1] but without the sigmoid",
          "[router]") {
  for (const std::string kind : {"router", "router_no_sigmoid", "global_scalar", "per_view_map"}) {
    const torch::Tensor alpha = make(kind)->forward(measured(), 1);
    INFO(kind);
    CHECK(alpha.sizes() == torch::IntArrayRef({1, kHeight, kWidth}));
    if (kind != "router_no_sigmoid") {
      CHECK(alpha.min().item<double>() >= 0);
      CHECK(alpha.max().item<double>() <= 1);
    }
  }
}

TEST_CASE("allocation: each kind has the parameters it should have", "[router]") {
  const auto count = [](const std::string& kind) {
    int64_t sum = 0;
    for (const torch::Tensor& parameter : make(kind)->parameters()) sum += parameter.numel();
    return sum;
  };
  CHECK(count("router") == 9314);
  CHECK(count("router_no_sigmoid") == 9314);
  CHECK(count("global_scalar") == 1);
  CHECK(count("per_view_map") == kViews * kHeight * kWidth);
}

TEST_CASE("allocation: the router without sigmoid is the same network, unbounded", "[router]") {
  const torch::Tensor in = measured();
  const torch::Tensor logits = make("router_no_sigmoid")->forward(in, 0);
  CHECK(torch::allclose(make("router")->forward(in, 0), logits.sigmoid()));
}

TEST_CASE("allocation: learned numbers and maps start where they should", "[router]") {
  CHECK((make("global_scalar")->forward(measured(), 0) == 0.5).all().item<bool>());
  CHECK((make("per_view_map")->forward(measured(), 2) == 0.5).all().item<bool>());
  CHECK_THROWS_AS(make("per_view_map")->forward(measured(), kViews), ContractError);
}

TEST_CASE("allocation: a per-view map learns its own view only", "[router]") {
  const auto allocation = make("per_view_map");
  allocation->forward(measured(), 1).sum().backward();
  const auto maps = allocation->parameters();
  REQUIRE(maps.size() == kViews);
  CHECK(maps[1].grad().abs().min().item<double>() > 0);
  CHECK_FALSE(maps[0].grad().defined());
  CHECK_FALSE(maps[2].grad().defined());
}

}  // namespace
}  // namespace jade::router
