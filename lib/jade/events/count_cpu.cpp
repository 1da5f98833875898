// SPDX-License-Identifier: Apache-2.0
#include <ATen/Parallel.h>
#include <algorithm>
#include <mutex>

#include "jade/events/count.h"
#include "jade/events/count_math.h"

namespace jade::events::cpu {
namespace {

void add_events(const CountArguments& in, int64_t begin, int64_t end, int64_t* planes) {
  const int64_t pixels = int64_t(in.width) * in.height;
  const float *x = in.x, *y = in.y;
  const int8_t* polarity = in.polarity;
  for (int64_t i = begin; i < end; ++i) {
    EventFootprint where;
    if (!locate(x[i], y[i], in.width, in.height, where)) continue;
    int64_t* plane = planes + (polarity[i] > 0 ? 0 : pixels);
    spread(where, in.width, in.height,
           [plane](int64_t pixel, int64_t weight) { plane[pixel] += weight; });
  }
}

}  // namespace

/// Each thread processes an equal share of the events. Time spans within one share are summed in
/// place; the one or two that a share boundary cuts use a private copy.
void count(const CountArguments& in) {
  const auto& bounds = *in.bounds;
  const int64_t spans = int64_t(bounds.size()) - 1;
  const int64_t plane_pair = 2 * int64_t(in.width) * in.height;
  std::mutex mutex;
  const int64_t grain = std::max<int64_t>(1 << 17, plane_pair / 4);
  at::parallel_for(bounds.front(), bounds.back(), grain, [&](int64_t begin, int64_t end) {
    std::vector<int64_t> cut;
    for (int64_t s = 0; s < spans; ++s) {
      const int64_t from = std::max(begin, bounds[s]), to = std::min(end, bounds[s + 1]);
      if (from >= to) continue;
      int64_t* planes = in.out + s * plane_pair;
      if (from == bounds[s] && to == bounds[s + 1]) {
        add_events(in, from, to, planes);
        continue;
      }
      cut.assign(size_t(plane_pair), 0);
      add_events(in, from, to, cut.data());
      const std::lock_guard<std::mutex> lock(mutex);
      for (int64_t i = 0; i < plane_pair; ++i) planes[i] += cut[size_t(i)];
    }
  });
}

}  // namespace jade::events::cpu
