// SPDX-License-Identifier: Apache-2.0
#include "jade/import/frame_change.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/events/pixels.h"

namespace jade::import {

double part_after(const data::Exposure& exposure, double t_us) {
  const auto end = double(exposure.t_end_us), start = double(exposure.t_start_us);
  if (end <= start) return t_us < end ? 1 : 0;
  return std::clamp((end - t_us) / (end - start), 0.0, 1.0);
}

torch::Tensor event_change(const data::Exposure& a, const data::Exposure& b,
                           const events::EventStream& events) {
  const events::ImageSize size{a.blurry.size(-2), a.blurry.size(-1)};
  const events::EventStream between = events.slice(a.t_start_us, b.t_end_us);
  torch::Tensor out = torch::zeros({size.height, size.width}, torch::kFloat32);
  float* const sums = out.data_ptr<float>();
  const float *x = between.x().const_data_ptr<float>(), *y = between.y().const_data_ptr<float>();
  const int64_t* t = between.t_us().const_data_ptr<int64_t>();
  const int8_t* p = between.polarity().const_data_ptr<int8_t>();
  for (int64_t i = 0; i < between.size(); ++i) {
    const int64_t at = events::pixel_of(x[i], y[i], size);
    if (at < 0) continue;
    const double weight = part_after(b, double(t[i])) - part_after(a, double(t[i]));
    sums[at] += float(p[i] * weight);
  }
  return out;
}

}  // namespace jade::import
