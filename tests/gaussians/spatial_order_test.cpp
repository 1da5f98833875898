// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/spatial_order.h"

#include "support/catch.h"

namespace jade::gaussians {
namespace {

TEST_CASE("spatial order: the corners of a cube along a Z-curve", "[gaussians]") {
  const torch::Tensor corners = torch::tensor({{1.0, 1.0, 1.0},
                                               {0.0, 0.0, 0.0},
                                               {0.0, 1.0, 0.0},
                                               {1.0, 0.0, 0.0},
                                               {0.0, 0.0, 1.0},
                                               {1.0, 1.0, 0.0}});
  CHECK(spatial_order(corners).equal(torch::tensor({1, 3, 2, 5, 4, 0}, torch::kInt64)));
}

TEST_CASE("spatial order: neighbours along it are nearer than in a random order", "[gaussians]") {
  torch::manual_seed(3);
  const torch::Tensor points = torch::rand({2000, 3});
  const torch::Tensor order = spatial_order(points);
  CHECK(std::get<0>(order.sort()).equal(torch::arange(2000)));
  const torch::Tensor sorted = points.index_select(0, order);
  const auto step = [](const torch::Tensor& rows) {
    return (rows.slice(0, 1) - rows.slice(0, 0, -1)).norm(2, 1).mean().item<double>();
  };
  CHECK(step(sorted) < 0.25 * step(points));
  CHECK(spatial_order(torch::empty({0, 3})).numel() == 0);
  CHECK(spatial_order(torch::ones({3, 3})).equal(torch::arange(3)));
}

}  // namespace
}  // namespace jade::gaussians
