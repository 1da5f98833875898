// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restorations.h"

#include "support/catch.h"

#include <torch/types.h>

namespace jade::restore {
namespace {

constexpr int64_t kHeight = 7, kWidth = 9;

TEST_CASE("fuse: α = 1 takes EDI, α = 0 takes EFNet, between is the mix of Eq. (4)", "[restore]") {
  const Restorations r{torch::tensor({0.75, 1.5, 0.25}).view({3, 1, 1}),
                       torch::tensor({0.25, 0.5, 0.25}).view({3, 1, 1})};
  const auto with = [&](double alpha) { return fuse(torch::full({1, 1, 1}, alpha), r).flatten(); };
  CHECK(torch::equal(with(1), r.edi.flatten()));
  CHECK(torch::equal(with(0), r.efnet.flatten()));
  CHECK(torch::allclose(with(0.25), torch::tensor({0.375, 0.75, 0.25})));
}

TEST_CASE("fuse: where both restorations agree the gradient to α is exactly zero, Eq. (5)",
          "[restore]") {
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
}  // namespace jade::restore
