// SPDX-License-Identifier: Apache-2.0
#include "jade/events/pixels.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <mutex>
#include <torch/types.h>
#include <vector>

#include "jade/core/check.h"

namespace jade::events {

torch::Tensor pixel_counts(const EventStream& events, const ImageSize& size) {
  JADE_CHECK(size.height > 0 && size.width > 0, "expected a sensor of 1 pixel or more");
  const int64_t pixels = size.height * size.width;
  torch::Tensor counts = torch::zeros({size.height, size.width}, torch::kInt64);
  int64_t* const all = counts.mutable_data_ptr<int64_t>();
  const float *x = events.x().const_data_ptr<float>(), *y = events.y().const_data_ptr<float>();
  std::mutex mutex;
  at::parallel_for(0, events.size(), std::max(kEventGrain, 8 * pixels),
                   [&](int64_t begin, int64_t end) {
                     // Threads would wait for shared counters. Own ones take at most a byte per
                     // event.
                     std::vector<int64_t> own(size_t(pixels), 0);
                     for (int64_t i = begin; i < end; ++i) {
                       const int64_t at = pixel_of(x[i], y[i], size);
                       if (at >= 0) ++own[size_t(at)];
                     }
                     const std::lock_guard<std::mutex> lock(mutex);
                     for (int64_t i = 0; i < pixels; ++i) all[i] += own[size_t(i)];
                   });
  return counts;
}

torch::Tensor kept_by(const torch::Tensor& mask, const EventStream& events) {
  check_shape(mask, "mask of pixels", {-1, -1});
  check_dtype(mask, "mask of pixels", torch::kBool);
  const torch::Tensor whole = mask.contiguous();
  const ImageSize size{mask.size(0), mask.size(1)};
  torch::Tensor keep = torch::empty({events.size()}, torch::kBool);
  const bool* counts = whole.const_data_ptr<bool>();
  const float *x = events.x().const_data_ptr<float>(), *y = events.y().const_data_ptr<float>();
  bool* out = keep.mutable_data_ptr<bool>();
  at::parallel_for(0, events.size(), kEventGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const int64_t at = pixel_of(x[i], y[i], size);
      out[i] = at < 0 || counts[at];
    }
  });
  return keep;
}

}  // namespace jade::events
