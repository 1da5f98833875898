// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

namespace jade::events {

/// Number of events per chunk of a thread.
inline constexpr int64_t kEventGrain = 1 << 16;

/// Half-open time span [begin_us, end_us).
struct TimeWindow {
  int64_t begin_us = 0, end_us = 0;
  int64_t duration_us() const { return end_us - begin_us; }
};

/// Size in pixels of the sensor or image of the events.
struct ImageSize {
  int64_t height = 0, width = 0;
};

/// @throws ContractError unless both sides have 1 to 32767 pixels.
void check_image_size(const ImageSize& size);

/// Events sorted by time, as four arrays: sub-pixel column x and row y (float32; x = 3 is the
/// centre of pixel column 3), time in int64 µs, polarity in int8, +1 brighter or −1 darker. 17
/// bytes per event. Copies and slices share the arrays: they are views that cost no memory and keep
/// the arrays alive. All four arrays are on one device.
class EventStream {
 public:
  /// No events.
  EventStream();

  /// Takes four contiguous tensors [N] without copying.
  /// @throws ContractError for other shapes, types or devices, for times that are not sorted (equal
  ///   times are fine) and for polarities other than ±1. NaN coordinates are allowed: sums ignore
  ///   them (see count_problems).
  EventStream(torch::Tensor x, torch::Tensor y, torch::Tensor t_us, torch::Tensor polarity);

  /// Copies four lists of equal length; otherwise as above.
  static EventStream from_lists(const std::vector<float>& x, const std::vector<float>& y,
                                const std::vector<int64_t>& t_us,
                                const std::vector<int8_t>& polarity);

  int64_t size() const { return t_us_.numel(); }
  bool empty() const { return size() == 0; }
  torch::Device device() const { return t_us_.device(); }

  const torch::Tensor& x() const { return x_; }
  const torch::Tensor& y() const { return y_; }
  const torch::Tensor& t_us() const { return t_us_; }
  const torch::Tensor& polarity() const { return polarity_; }

  /// Time of the first and of the last event. @throws ContractError when empty.
  int64_t first_us() const;
  int64_t last_us() const;

  /// Events with begin_us ≤ t < end_us, as a view: two binary searches and no copy. A window that
  /// ends before it begins contains no event.
  EventStream slice(const TimeWindow& window) const;
  EventStream slice(int64_t begin_us, int64_t end_us) const {
    return slice(TimeWindow{begin_us, end_us});
  }

  /// Events begin, begin + 1, …, end − 1 of this view, as a view.
  EventStream range(int64_t begin, int64_t end) const;

  /// The events where `keep`, [N] bool, is true, as a copy.
  EventStream select(const torch::Tensor& keep) const;

  /// Number of events before `t_us`: the index of the first one at or after it.
  int64_t count_before(int64_t t_us) const;

  /// Copies the events to a device; shares the arrays if they are already there.
  EventStream to(torch::Device device) const;

 private:
  torch::Tensor x_, y_, t_us_, polarity_;
};

/// Counts of invalid events in a stream. Voxels and windows ignore such events.
struct EventProblems {
  int64_t not_finite = 0;  ///< x or y is NaN or Inf
  int64_t outside = 0;     ///< one pixel or more from every pixel centre
};

/// One pass over the events, threaded; CPU streams only.
EventProblems count_problems(const EventStream& events, const ImageSize& size);

}  // namespace jade::events
