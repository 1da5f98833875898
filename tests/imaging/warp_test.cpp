// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/warp.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"

using namespace jade::imaging;

namespace {

/// A map that shifts everything by (dx, dy).
torch::Tensor shift(int64_t height, int64_t width, double dx, double dy) {
  const auto axes = torch::meshgrid({torch::arange(height), torch::arange(width)}, "ij");
  return torch::stack({axes[1] + dx, axes[0] + dy}).to(torch::kFloat32);
}

}  // namespace

TEST_CASE("warp: the identity leaves the image, a whole pixel moves it", "[imaging]") {
  const auto image = torch::rand({3, 20, 30});
  CHECK(remap(image, shift(20, 30, 0, 0)).equal(image));
  const auto moved = remap(image, shift(20, 30, 2, -1));
  CHECK(moved.slice(1, 1, 20).slice(2, 0, 28).equal(image.slice(1, 0, 19).slice(2, 2, 30)));
  // More than a pixel outside the image the result is black.
  CHECK(moved.slice(2, 29, 30).abs().max().item<float>() == 0);
}

TEST_CASE("warp: between pixels a smooth image is met", "[imaging]") {
  const auto wave = [](double dx) {
    return (0.5 + 0.3 * torch::sin(0.4 * (torch::arange(40) + dx)))
        .to(torch::kFloat32)
        .expand({1, 8, 40})
        .contiguous();
  };
  const auto got = remap(wave(0), shift(8, 40, 0.375, 0));
  CHECK((got - wave(0.375)).slice(2, 2, 37).abs().max().item<float>() < 5e-3f);
}

TEST_CASE("warp: NaN is black, values stay in [0,1]", "[imaging]") {
  auto map = shift(8, 8, 0.5, 0);
  map[0][3][4] = std::nanf("");
  const auto image = (torch::rand({1, 8, 8}) > 0.5).to(torch::kFloat32);
  const auto got = remap(image, map);
  CHECK(got[0][3][4].item<float>() == 0);
  CHECK((got.min().item<float>() >= 0 && got.max().item<float>() <= 1));
  CHECK_THROWS_AS(remap(image, map[0]), jade::ContractError);
}
