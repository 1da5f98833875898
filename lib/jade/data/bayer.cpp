// SPDX-License-Identifier: Apache-2.0
#include "jade/data/bayer.h"

#include <cmath>
#include <limits>
#include <torch/types.h>
#include <vector>

#include "jade/core/check.h"
#include "jade/io/npy.h"

namespace jade::data {

torch::Tensor event_color_map(const torch::Tensor& map_x, const torch::Tensor& map_y,
                              int64_t height, int64_t width) {
  JADE_CHECK(map_x.dim() == 2 && map_x.sizes() == map_y.sizes(), "colour map of shapes ",
             shape_string(map_x), " and ", shape_string(map_y));
  const torch::Tensor xs = map_x.to(torch::kFloat64).contiguous();
  const torch::Tensor ys = map_y.to(torch::kFloat64).contiguous();
  torch::Tensor out = torch::zeros({3, height, width}, torch::kBool);
  bool* channel = out.data_ptr<bool>();
  const int64_t plane = height * width;
  std::vector<double> nearest(static_cast<size_t>(plane), std::numeric_limits<double>::infinity());
  const double* x = xs.data_ptr<double>();
  const double* y = ys.data_ptr<double>();
  for (int64_t i = 0; i < xs.size(0); ++i) {
    for (int64_t j = 0; j < xs.size(1); ++j, ++x, ++y) {
      const double column = std::round(*x);
      const double row = std::round(*y);
      if (!(column >= 0 && column < double(width) && row >= 0 && row < double(height))) continue;
      const int64_t pixel = int64_t(row) * width + int64_t(column);
      const double distance = std::hypot(*x - column, *y - row);
      if (distance >= nearest[size_t(pixel)]) continue;
      nearest[size_t(pixel)] = distance;
      const int64_t color = filter_channel(i, j);
      for (int64_t c = 0; c < 3; ++c) channel[c * plane + pixel] = c == color;
    }
  }
  return out;
}

torch::Tensor read_event_color_map(const std::filesystem::path& path, int64_t height, int64_t width,
                                   const Warnings& warnings) {
  const io::Npz archive(path);
  const torch::Tensor x = archive.read("inv_mapx");
  const torch::Tensor y = archive.read("inv_mapy");
  if (x.dim() != 2 || x.sizes() != y.sizes()) {
    throw DataError(concat(path.string(),
                           ": expected inv_mapx and inv_mapy of one shape [H,W], "
                           "found ",
                           x.sizes(), " and ", y.sizes()));
  }
  constexpr double kLeastRefused = 0.1, kLeastTold = 0.6;  // of the image
  torch::Tensor colors = event_color_map(x, y, height, width);
  const double share =
      double(colors.any(0).sum().item<int64_t>()) / (double(height) * double(width));
  if (share >= kLeastTold) return colors;
  const torch::Tensor numbers = x.to(torch::kFloat64) + y.to(torch::kFloat64);
  const int64_t not_finite = numbers.isfinite().logical_not().sum().item<int64_t>();
  const std::string found =
      concat(path.string(), ": expected the place of each event pixel in the ", width, "x", height,
             " image, found places for ", 0.1 * std::round(1000 * share), " % of it",
             not_finite == 0 ? "" : concat(" and ", not_finite, " of ", x.numel(), " NaN or Inf"),
             "; write the map again, in pixels of the image, or set dataset.color_events false");
  if (share < kLeastRefused) throw DataError(found);
  warnings.add(found);
  return colors;
}

void write_event_color_map(const std::filesystem::path& path, const torch::Tensor& map) {
  check_shape(map, "map of event pixels", {2, -1, -1});
  const torch::Tensor places = map.to(torch::kFloat32);
  io::write_npz(path, {{"inv_mapx", places[0].contiguous()}, {"inv_mapy", places[1].contiguous()}});
}

void write_event_color_map(const std::filesystem::path& path, int64_t height, int64_t width) {
  const auto axes = torch::meshgrid({torch::arange(height), torch::arange(width)}, "ij");
  write_event_color_map(path, torch::stack({axes[1], axes[0]}));
}

}  // namespace jade::data
