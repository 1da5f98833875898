// SPDX-License-Identifier: Apache-2.0
#include "jade/data/bayer.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::data {
namespace {

TEST_CASE("bayer: without distortion the map is the RGGB pattern", "[data]") {
  const auto axes = torch::meshgrid({torch::arange(4), torch::arange(6)}, "ij");
  const torch::Tensor map =
      event_color_map(axes[1].to(torch::kFloat32), axes[0].to(torch::kFloat32), 4, 6);
  for (int64_t row = 0; row < 4; ++row) {
    for (int64_t column = 0; column < 6; ++column) {
      const int64_t color = row % 2 + column % 2;
      for (int64_t c = 0; c < 3; ++c) CHECK(map[c][row][column].item<bool>() == (c == color));
    }
  }
}

TEST_CASE("bayer: the raw pixel nearest to a rectified pixel gives its colour", "[data]") {
  // Raw (0,0) red and raw (0,1) green both land on pixel 1; raw (1,0) and (1,1) land nowhere.
  const torch::Tensor x = torch::tensor({{0.7, 1.1}, {std::nan(""), 90.0}});
  const torch::Tensor y = torch::tensor({{0.0, 0.1}, {0.0, 0.0}});
  const torch::Tensor map = event_color_map(x, y, 1, 3);
  CHECK(map.sum().item<int64_t>() == 1);
  CHECK(map[1][0][1].item<bool>());
}

TEST_CASE("bayer: maps of different shapes are refused", "[data]") {
  CHECK_THROWS_AS(event_color_map(torch::zeros({2, 2}), torch::zeros({2, 3}), 2, 2), ContractError);
}

}  // namespace
}  // namespace jade::data
