// SPDX-License-Identifier: Apache-2.0
#include "jade/events/warp.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::events {
namespace {

/// Bilinear samples of the two planes of a map.
struct MapReader {
  const float* columns;
  const float* rows;
  int64_t height, width;

  explicit MapReader(const torch::Tensor& map)
      : columns(map.const_data_ptr<float>()),
        rows(columns + map.size(1) * map.size(2)),
        height(map.size(1)),
        width(map.size(2)) {}

  bool covers(float x, float y) const {
    return x >= 0 && y >= 0 && x <= float(width - 1) && y <= float(height - 1);
  }

  float at(const float* plane, float x, float y) const {
    const auto x0 = int64_t(x), y0 = int64_t(y);
    const float fx = x - float(x0), fy = y - float(y0);
    const int64_t here = y0 * width + x0;
    // The neighbour of a whole coordinate may be outside the map, or NaN.
    const int64_t right = fx > 0 ? 1 : 0, down = fy > 0 ? width : 0;
    const float top = plane[here] * (1 - fx) + plane[here + right] * fx;
    return top * (1 - fy) + (plane[here + down] * (1 - fx) + plane[here + down + right] * fx) * fy;
  }
};

}  // namespace

WarpedEvents warp(const EventStream& events, const torch::Tensor& map, const ImageSize& size) {
  check_shape(map, "event map", {2, -1, -1});
  check_dtype(map, "event map", torch::kFloat32);
  JADE_CHECK(map.is_cpu() && events.device().is_cpu() && map.numel() > 0,
             "warp: expected events and a map on the CPU");
  const torch::Tensor places = map.contiguous();
  const MapReader reader(places);
  const int64_t count = events.size();
  auto x = torch::empty({count}, torch::kFloat32), y = torch::empty({count}, torch::kFloat32);
  auto t = torch::empty({count}, torch::kInt64);
  auto p = torch::empty({count}, torch::kInt8);
  const float *x_in = events.x().const_data_ptr<float>(),
              *y_in = events.y().const_data_ptr<float>();
  const int64_t* t_in = events.t_us().const_data_ptr<int64_t>();
  const int8_t* p_in = events.polarity().const_data_ptr<int8_t>();
  float *x_out = x.mutable_data_ptr<float>(), *y_out = y.mutable_data_ptr<float>();
  int64_t* t_out = t.mutable_data_ptr<int64_t>();
  int8_t* p_out = p.mutable_data_ptr<int8_t>();
  int64_t kept = 0;
  for (int64_t i = 0; i < count; ++i) {
    if (!reader.covers(x_in[i], y_in[i])) continue;
    const float u = reader.at(reader.columns, x_in[i], y_in[i]);
    const float v = reader.at(reader.rows, x_in[i], y_in[i]);
    if (!(u > -1 && u < float(size.width) && v > -1 && v < float(size.height))) continue;
    x_out[kept] = u, y_out[kept] = v, t_out[kept] = t_in[i], p_out[kept] = p_in[i];
    ++kept;
  }
  // Avoids a copy, which would double the memory of the events.
  const auto head = [&](const torch::Tensor& all) { return all.narrow(0, 0, kept); };
  return {{head(x), head(y), head(t), head(p)}, count - kept};
}

}  // namespace jade::events
