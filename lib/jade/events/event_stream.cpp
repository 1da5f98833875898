// SPDX-License-Identifier: Apache-2.0
#include "jade/events/event_stream.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <torch/types.h>
#include <utility>

#include "jade/core/check.h"

namespace jade::events {
namespace {

/// Index of the first time that is smaller than its predecessor, or -1.
int64_t first_unsorted(const torch::Tensor& t_us) {
  const int64_t n = t_us.numel();
  if (!t_us.is_cpu()) {
    return n < 2 || t_us.diff().ge(0).all().item<bool>() ? -1 : 0;
  }
  const int64_t* t = t_us.const_data_ptr<int64_t>();
  std::atomic<int64_t> bad{n};
  at::parallel_for(1, std::max<int64_t>(n, 1), kEventGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      if (t[i] < t[i - 1]) {
        int64_t seen = bad.load();
        while (i < seen && !bad.compare_exchange_weak(seen, i)) {
        }
        return;
      }
    }
  });
  return bad.load() == n ? -1 : bad.load();
}

bool polarities_are_signs(const torch::Tensor& polarity) {
  if (!polarity.is_cpu()) return polarity.abs().eq(1).all().item<bool>();
  const int8_t* p = polarity.const_data_ptr<int8_t>();
  std::atomic<bool> good{true};
  at::parallel_for(0, polarity.numel(), kEventGrain, [&](int64_t begin, int64_t end) {
    bool all = true;
    for (int64_t i = begin; i < end; ++i) all &= p[i] == 1 || p[i] == -1;
    if (!all) good = false;
  });
  return good;
}

torch::Tensor copied(const void* data, size_t count, torch::ScalarType type) {
  return torch::from_blob(const_cast<void*>(data), {int64_t(count)}, type).clone();
}

}  // namespace

void check_image_size(const ImageSize& size) {
  JADE_CHECK(size.height > 0 && size.width > 0 && size.height < 32768 && size.width < 32768,
             "expected an image of 1 to 32767 pixels a side, found ", size.height, " x ",
             size.width);
}

EventStream::EventStream()
    : x_(torch::empty({0}, torch::kFloat32)),
      y_(torch::empty({0}, torch::kFloat32)),
      t_us_(torch::empty({0}, torch::kInt64)),
      polarity_(torch::empty({0}, torch::kInt8)) {}

EventStream::EventStream(torch::Tensor x, torch::Tensor y, torch::Tensor t_us,
                         torch::Tensor polarity)
    : x_(std::move(x)), y_(std::move(y)), t_us_(std::move(t_us)), polarity_(std::move(polarity)) {
  check_dtype(x_, "event x", torch::kFloat32);
  check_dtype(y_, "event y", torch::kFloat32);
  check_dtype(t_us_, "event t_us", torch::kInt64);
  check_dtype(polarity_, "event polarity", torch::kInt8);
  check_shape(t_us_, "event t_us", {-1});
  const int64_t n = t_us_.numel();
  for (const auto& [tensor, name] : {std::pair{x_, "event x"}, std::pair{y_, "event y"},
                                     std::pair{polarity_, "event polarity"}}) {
    check_shape(tensor, name, {n});
    check_same_device(tensor, name, t_us_, "event t_us");
    JADE_CHECK(tensor.is_contiguous(), name, ": expected a contiguous tensor");
  }
  JADE_CHECK(t_us_.is_contiguous(), "event t_us: expected a contiguous tensor");
  const int64_t unsorted = first_unsorted(t_us_);
  JADE_CHECK(unsorted < 0, "expected events in order of time, found event ", unsorted,
             " before the one ahead of it; sort_events() orders them");
  JADE_CHECK(polarities_are_signs(polarity_), "expected polarities +1 and -1 only");
}

EventStream EventStream::from_lists(const std::vector<float>& x, const std::vector<float>& y,
                                    const std::vector<int64_t>& t_us,
                                    const std::vector<int8_t>& polarity) {
  return {copied(x.data(), x.size(), torch::kFloat32), copied(y.data(), y.size(), torch::kFloat32),
          copied(t_us.data(), t_us.size(), torch::kInt64),
          copied(polarity.data(), polarity.size(), torch::kInt8)};
}

int64_t EventStream::first_us() const {
  JADE_CHECK(!empty(), "an empty event stream has no first event");
  return t_us_[0].item<int64_t>();
}

int64_t EventStream::last_us() const {
  JADE_CHECK(!empty(), "an empty event stream has no last event");
  return t_us_[size() - 1].item<int64_t>();
}

int64_t EventStream::count_before(int64_t t_us) const {
  if (t_us_.is_cpu()) {
    const int64_t* begin = t_us_.const_data_ptr<int64_t>();
    return std::lower_bound(begin, begin + size(), t_us) - begin;
  }
  return torch::searchsorted(t_us_, torch::full({1}, t_us, t_us_.options())).item<int64_t>();
}

EventStream EventStream::slice(const TimeWindow& window) const {
  const int64_t begin = count_before(window.begin_us);
  return range(begin, std::max(begin, count_before(window.end_us)));
}

EventStream EventStream::range(int64_t begin, int64_t end) const {
  JADE_CHECK(0 <= begin && begin <= end && end <= size(), "expected 0 <= begin <= end <= ", size(),
             ", found [", begin, ", ", end, ")");
  EventStream out;  // bypasses the checking constructor: a slice of a valid stream is valid
  out.x_ = x_.narrow(0, begin, end - begin);
  out.y_ = y_.narrow(0, begin, end - begin);
  out.t_us_ = t_us_.narrow(0, begin, end - begin);
  out.polarity_ = polarity_.narrow(0, begin, end - begin);
  return out;
}

EventStream EventStream::select(const torch::Tensor& keep) const {
  const torch::Tensor index = keep.nonzero().flatten();
  const auto kept = [&](const torch::Tensor& all) { return all.index_select(0, index); };
  return {kept(x_), kept(y_), kept(t_us_), kept(polarity_)};
}

EventStream EventStream::to(torch::Device device) const {
  EventStream out;
  out.x_ = x_.to(device);
  out.y_ = y_.to(device);
  out.t_us_ = t_us_.to(device);
  out.polarity_ = polarity_.to(device);
  return out;
}

EventProblems count_problems(const EventStream& events, const ImageSize& size) {
  JADE_CHECK(events.device().is_cpu(), "count_problems: expected events on the CPU");
  const float* x = events.x().const_data_ptr<float>();
  const float* y = events.y().const_data_ptr<float>();
  const float width = float(size.width), height = float(size.height);
  std::atomic<int64_t> not_finite{0}, outside{0};
  at::parallel_for(0, events.size(), kEventGrain, [&](int64_t begin, int64_t end) {
    int64_t bad = 0, out = 0;
    for (int64_t i = begin; i < end; ++i) {
      const float u = x[i], v = y[i];
      if (u > -1 && u < width && v > -1 && v < height) continue;
      ++(std::isfinite(u) && std::isfinite(v) ? out : bad);
    }
    not_finite += bad;
    outside += out;
  });
  return {not_finite, outside};
}

}  // namespace jade::events
