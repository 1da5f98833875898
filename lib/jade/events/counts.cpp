// SPDX-License-Identifier: Apache-2.0
#include "jade/events/counts.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <mutex>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/events/kernels.h"
#include "jade/events/splat_math.h"

namespace jade::events {
namespace {

/// Event indices at which the spans begin and end.
std::vector<int64_t> span_bounds(const EventStream& events, const std::vector<int64_t>& knots_us) {
  std::vector<int64_t> out;
  if (events.device().is_cpu()) {
    for (const int64_t knot : knots_us) out.push_back(events.count_before(knot));
    return out;
  }
  const auto knots = torch::tensor(knots_us, torch::kInt64).to(events.device());
  const auto found = torch::searchsorted(events.t_us(), knots).to(torch::kCPU, torch::kInt64);
  const int64_t* data = found.const_data_ptr<int64_t>();
  out.assign(data, data + found.numel());
  return out;
}

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

/// Threads take equal shares of the events. Spans that lie in one share are summed in place, the
/// one or two that a share cuts go through a private copy.
void count_cpu(const CountArguments& in) {
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

}  // namespace

int64_t knot_us(const TimeWindow& window, int64_t k, int64_t parts) {
  const int64_t duration = window.duration_us();
  JADE_CHECK(duration >= 0 && parts > 0 && k >= 0 && k <= parts,
             "expected a window that ends after it begins, found [", window.begin_us, ", ",
             window.end_us, ") us");
  // duration · k could overflow for absurd windows; split it first.
  const int64_t whole = duration / parts, rest = duration % parts;
  return window.begin_us + whole * k + (rest * k + parts - 1) / parts;
}

torch::Tensor count_events(const EventStream& events, const std::vector<int64_t>& knots_us,
                           const ImageSize& size) {
  JADE_CHECK(knots_us.size() >= 2 && std::is_sorted(knots_us.begin(), knots_us.end()),
             "expected two or more knots in order of time, found ", knots_us.size());
  JADE_CHECK(size.height > 0 && size.width > 0 && size.height < 32768 && size.width < 32768,
             "expected an image of 1 to 32767 pixels a side, found ", size.height, " x ",
             size.width);
  const int64_t spans = int64_t(knots_us.size()) - 1;
  auto out = torch::empty({spans, 2, size.height, size.width},
                          torch::dtype(torch::kInt64).device(events.device()));
  if (out.is_cpu()) {
    std::memset(out.mutable_data_ptr(), 0, out.nbytes());  // zero_() would wake all threads
  } else {
    out.zero_();
  }
  const auto bounds = span_bounds(events, knots_us);
  CountArguments in;
  in.x = events.x().const_data_ptr<float>();
  in.y = events.y().const_data_ptr<float>();
  in.polarity = events.polarity().const_data_ptr<int8_t>();
  in.bounds = &bounds;
  in.width = int32_t(size.width);
  in.height = int32_t(size.height);
  in.out = out.mutable_data_ptr<int64_t>();
  if (bounds.back() > bounds.front()) {
    events.device().is_cpu() ? count_cpu(in) : count_cuda(in, events.device().index());
  }
  return out;
}

torch::Tensor to_events(const torch::Tensor& counts) {
  check_dtype(counts, "event counts", torch::kInt64);
  return counts.to(torch::kFloat64).mul_(kCountUnit).to(torch::kFloat32);
}

torch::Tensor signed_count(const EventStream& events, const ImageSize& size) {
  const auto counts = count_events(
      events, {std::numeric_limits<int64_t>::min(), std::numeric_limits<int64_t>::max()}, size);
  if (!counts.is_cpu()) return to_events(counts[0][0] - counts[0][1]);
  // The same in one pass. A training step asks for a small window, and waking all threads for each
  // of five operations takes longer than they do, a hundred times so where the processor is busy.
  const auto out = torch::empty({size.height, size.width}, torch::kFloat32);
  const int64_t pixels = out.numel();
  const int64_t* const positive = counts.const_data_ptr<int64_t>();
  float* const data = out.mutable_data_ptr<float>();
  at::parallel_for(0, pixels, 1 << 18, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      data[i] =
          static_cast<float>(static_cast<double>(positive[i] - positive[i + pixels]) * kCountUnit);
    }
  });
  return out;
}

torch::Tensor event_density(const EventStream& events, const ImageSize& size) {
  const auto counts = count_events(
      events, {std::numeric_limits<int64_t>::min(), std::numeric_limits<int64_t>::max()}, size);
  return to_events(counts[0][0] + counts[0][1]);
}

}  // namespace jade::events
