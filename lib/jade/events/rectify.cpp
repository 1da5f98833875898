// SPDX-License-Identifier: Apache-2.0
#include "jade/events/rectify.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <limits>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::events {

EventStream rectify(const EventStream& events, const torch::Tensor& map) {
  check_shape(map, "rectification map", {2, -1, -1});
  check_dtype(map, "rectification map", torch::kFloat32);
  JADE_CHECK(map.is_cpu() && events.device().is_cpu() && map.numel() > 0,
             "rectify: expected events on the CPU");
  const auto places = map.contiguous();
  const int64_t height = map.size(1), width = map.size(2);
  const float *map_x = places.const_data_ptr<float>(), *map_y = map_x + height * width;
  auto x_out = torch::empty_like(events.x()), y_out = torch::empty_like(events.y());
  const float *x_in = events.x().const_data_ptr<float>(),
              *y_in = events.y().const_data_ptr<float>();
  float *xs = x_out.mutable_data_ptr<float>(), *ys = y_out.mutable_data_ptr<float>();
  at::parallel_for(0, events.size(), 1 << 14, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const float x = x_in[i], y = y_in[i];
      if (!(x >= 0 && y >= 0 && x <= float(width - 1) && y <= float(height - 1))) {
        xs[i] = ys[i] = std::numeric_limits<float>::quiet_NaN();
        continue;
      }
      const int64_t x0 = int64_t(x), y0 = int64_t(y);
      const float fx = x - float(x0), fy = y - float(y0);
      const int64_t here = y0 * width + x0;
      const int64_t right = fx > 0 ? 1 : 0, down = fy > 0 ? width : 0;
      const auto at = [&](const float* plane) {
        const float top = plane[here] * (1 - fx) + plane[here + right] * fx;
        return top * (1 - fy) +
               (plane[here + down] * (1 - fx) + plane[here + down + right] * fx) * fy;
      };
      xs[i] = at(map_x);
      ys[i] = at(map_y);
    }
  });
  return {x_out, y_out, events.t_us(), events.polarity()};
}

}  // namespace jade::events
