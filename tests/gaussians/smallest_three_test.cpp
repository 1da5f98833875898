// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/smallest_three.h"

#include "support/catch.h"

#include <cmath>

namespace jade::gaussians {
namespace {

TEST_CASE("smallest three: the quaternion is restored with its largest component positive",
          "[gaussians]") {
  torch::manual_seed(2);
  const torch::Tensor q = torch::randn({500, 4}, torch::kFloat64);
  const SmallestThree parts = smallest_three(q);
  CHECK(parts.others.abs().max().item<double>() <= std::sqrt(0.5) + 1e-12);
  CHECK(torch::bincount(parts.largest, {}, 4).min().item<int64_t>() > 0);
  const torch::Tensor unit = q / q.norm(2, 1, true);
  const torch::Tensor back = joined(parts);
  CHECK(back.gather(1, parts.largest.unsqueeze(1)).min().item<double>() > 0);
  CHECK((unit * back).sum(1).abs().min().item<double>() > 1 - 1e-12);
  // By hand: the largest is y, negative.
  const SmallestThree one = smallest_three(torch::tensor({{1.0, 2.0, -4.0, 2.0}}));
  CHECK(one.largest.item<int64_t>() == 2);
  CHECK(torch::allclose(one.others, torch::tensor({{-0.2, -0.4, -0.4}})));
  CHECK(joined(smallest_three(torch::zeros({1, 4}))).equal(torch::tensor({{1.f, 0.f, 0.f, 0.f}})));
}

TEST_CASE("smallest three: fields of ten bits share a number of 32", "[gaussians]") {
  const torch::Tensor fields = torch::tensor({{1, 2, 3}, {1023, 0, 512}}, torch::kInt64);
  const torch::Tensor packed = packed_32(torch::tensor({2, 3}, torch::kInt64), fields);
  CHECK(packed[0].item<int64_t>() == (2LL << 30 | 1 << 20 | 2 << 10 | 3));
  CHECK(fields_of(packed).equal(fields));
  CHECK(packed.max().item<int64_t>() < (1LL << 32));
}

}  // namespace
}  // namespace jade::gaussians
