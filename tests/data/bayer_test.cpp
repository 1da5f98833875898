// SPDX-License-Identifier: Apache-2.0
#include "jade/data/bayer.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"

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

TEST_CASE("bayer: a map that leaves the image without colours is refused or reported", "[data]") {
  const test::TempDir folder;
  const std::filesystem::path path = folder / "ev_map.npz";
  std::vector<std::string> lines;
  const auto read = [&] { return read_event_color_map(path, 8, 10, Warnings(&lines)); };
  write_event_color_map(path, 8, 10);
  CHECK(read().any(0).all().item<bool>());
  CHECK(lines.empty());

  const auto axes = torch::meshgrid({torch::arange(8), torch::arange(10)}, "ij");
  torch::Tensor map = torch::stack({axes[1], axes[0]}).to(torch::kFloat32);
  map.slice(2, 5) = std::nan("");
  write_event_color_map(path, map);
  read();
  REQUIRE(lines.size() == 1);
  CHECK_THAT(lines[0], test::naming("ev_map.npz", "50 %", "40 of 80"));
  for (const torch::Tensor& useless : {map * std::nan(""), map * 0, map + 1000}) {
    write_event_color_map(path, useless);
    CHECK_THROWS_NAMING(DataError, read(), "ev_map.npz", "dataset.color_events");
  }
}

}  // namespace
}  // namespace jade::data
