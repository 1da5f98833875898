// SPDX-License-Identifier: Apache-2.0
#include "jade/events/counts.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cstring>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/events/count.h"
#include "jade/events/count_math.h"
#include "jade/kernel/on_cuda.h"

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

/// [S,2,H,W] of the events bounds[s], …, bounds[s + 1] − 1. Does not wait for the device.
torch::Tensor count_spans(const EventStream& events, const std::vector<int64_t>& bounds,
                          const ImageSize& size) {
  check_image_size(size);
  const int64_t spans = int64_t(bounds.size()) - 1;
  auto out = torch::empty({spans, 2, size.height, size.width},
                          torch::dtype(torch::kInt64).device(events.device()));
  if (out.is_cpu()) {
    std::memset(out.mutable_data_ptr(), 0, out.nbytes());  // zero_() would wake all threads
  } else {
    out.zero_();
  }
  CountArguments in;
  in.x = events.x().const_data_ptr<float>();
  in.y = events.y().const_data_ptr<float>();
  in.polarity = events.polarity().const_data_ptr<int8_t>();
  in.bounds = &bounds;
  in.width = int32_t(size.width);
  in.height = int32_t(size.height);
  in.out = out.mutable_data_ptr<int64_t>();
  if (bounds.back() == bounds.front()) return out;
  if (out.is_cpu()) {
    cpu::count(in);
  } else {
    kernel::on_cuda("the counting of events", [&] { cuda::count(in, out.device().index()); });
  }
  return out;
}

}  // namespace

int64_t knot_us(const TimeWindow& window, int64_t k, int64_t parts) {
  const int64_t duration = window.duration_us();
  JADE_CHECK(duration >= 0 && parts > 0, "expected a window that ends after it begins, found [",
             window.begin_us, ", ", window.end_us, ") us");
  // duration · k could overflow for extreme windows; split it first.
  const int64_t whole = duration / parts, rest = duration % parts * k;
  return window.begin_us + whole * k + rest / parts + (rest % parts > 0 ? 1 : 0);
}

torch::Tensor count_events(const EventStream& events, const std::vector<int64_t>& knots_us,
                           const ImageSize& size) {
  JADE_CHECK(knots_us.size() >= 2 && std::is_sorted(knots_us.begin(), knots_us.end()),
             "expected two or more knots in order of time, found ", knots_us.size());
  return count_spans(events, span_bounds(events, knots_us), size);
}

torch::Tensor to_events(const torch::Tensor& counts) {
  check_dtype(counts, "event counts", torch::kInt64);
  return counts.to(torch::kFloat64).mul_(kCountUnit).to(torch::kFloat32);
}

torch::Tensor signed_count(const EventStream& events, const ImageSize& size) {
  const auto counts = count_spans(events, {0, events.size()}, size);
  if (!counts.is_cpu()) return to_events(counts[0][0] - counts[0][1]);
  // A single pass: a training step needs a small window, and waking all threads for each of five
  // operations takes longer than the operations.
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
  const auto counts = count_spans(events, {0, events.size()}, size);
  return to_events(counts[0][0] + counts[0][1]);
}

}  // namespace jade::events
