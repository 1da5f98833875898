// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/color.h"

#include "support/catch.h"

#include <torch/csrc/autograd/autograd.h>
#include <torch/types.h>

#include "jade/core/error.h"

using namespace jade::imaging;

TEST_CASE("gray: red, green and blue weigh 0.299, 0.587 and 0.114", "[imaging]") {
  const auto rgb =
      torch::tensor({1.0, 10.0, 100.0}, torch::kFloat64).view({3, 1, 1}).expand({2, 3, 4, 5});
  const auto out = gray(rgb);
  CHECK(out.sizes() == torch::IntArrayRef({2, 1, 4, 5}));
  CHECK(out.sub(0.299 + 5.87 + 11.4).abs().max().item<double>() < 1e-12);
  CHECK_THROWS_AS(gray(torch::zeros({1, 4, 5})), jade::ContractError);
}

TEST_CASE("gray: the gradient reaches each channel with its weight", "[imaging]") {
  auto rgb = torch::rand({3, 2, 2}, torch::kFloat64).requires_grad_(true);
  gray(rgb).sum().backward();
  for (int c = 0; c < 3; ++c)
    CHECK(rgb.grad()[c].sub(kGrayWeights[c]).abs().max().item<double>() < 1e-12);
}

TEST_CASE("gray: images with strides, and both devices, give one number", "[imaging]") {
  auto rgb = torch::rand({2, 7, 9, 3}, torch::kFloat64).requires_grad_(true);
  const auto seen = rgb.permute({0, 3, 1, 2});
  const auto slow = kGrayWeights[0] * seen.narrow(1, 0, 1) +
                    kGrayWeights[1] * seen.narrow(1, 1, 1) + kGrayWeights[2] * seen.narrow(1, 2, 1);
  CHECK(gray(seen).equal(slow));
  const auto cotangent = torch::rand_like(slow);
  const auto fast = torch::autograd::grad({gray(seen)}, {rgb}, {cotangent});
  CHECK(fast[0].equal(torch::autograd::grad({slow}, {rgb}, {cotangent})[0]));
  CHECK_THROWS_AS(gray(torch::zeros({3, 4, 5}, torch::kUInt8)), jade::ContractError);
}

TEST_CASE("gray: a GPU agrees with the CPU, gradients too", "[imaging][cuda]") {
  const auto rgb = torch::rand({2, 3, 37, 41}).requires_grad_(true);
  const auto on_gpu = rgb.detach().cuda().requires_grad_(true);
  gray(rgb).square().sum().backward();
  gray(on_gpu).square().sum().backward();
  CHECK(gray(on_gpu).cpu().sub(gray(rgb)).abs().max().item<double>() < 1e-6);
  CHECK(on_gpu.grad().cpu().sub(rgb.grad()).abs().max().item<double>() < 1e-6);
}

TEST_CASE("as_gray: three equal channels; what is gray stays so to the bit", "[imaging]") {
  const auto rgb = torch::rand({3, 20, 30});
  CHECK_FALSE(is_gray(rgb));
  const auto out = as_gray(rgb);
  CHECK(is_gray(out));
  CHECK(out[2].equal(gray(rgb)[0]));
  CHECK(as_gray(out).equal(out));
  auto blue = out.clone();
  blue[2][19][29] += 1e-6;
  CHECK_FALSE(is_gray(blue));
  CHECK_THROWS_AS(is_gray(torch::zeros({1, 4, 5})), jade::ContractError);
}
