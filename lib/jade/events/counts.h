// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/events/event_stream.h"

namespace jade::events {

/// First whole microsecond at or after begin + duration · k / parts, the k-th of parts + 1 equal
/// knots; k below 0 and beyond `parts` goes on outside the window. An event at time t belongs to
/// part k when knot_k ≤ t < knot_{k+1}, exactly.
int64_t knot_us(const TimeWindow& window, int64_t k, int64_t parts);

/// Bilinear sums of positive and negative events in consecutive spans of time,
///     P_s(r, c) = Σ_i max(0, 1 − |x_i − c|) · max(0, 1 − |y_i − r|),  knots_s ≤ t_i < knots_{s+1}.
/// One pass over the events; each pixel has its middle at whole coordinates. Weights that fall
/// beside the image are dropped, those on it are kept; events that touch no pixel and NaN
/// coordinates count nowhere. The same bits for any number of threads, on CPU and CUDA.
/// @param knots_us  S + 1 times, not decreasing.
/// @return [S,2,H,W] int64 on the events' device, positive first, in units of 2⁻³⁰ events.
torch::Tensor count_events(const EventStream& events, const std::vector<int64_t>& knots_us,
                           const ImageSize& size);

/// Counts as float32 numbers of events.
torch::Tensor to_events(const torch::Tensor& counts);

/// Σ polarity over all events of the stream, [H,W] float32, for the event loss.
torch::Tensor signed_count(const EventStream& events, const ImageSize& size);

/// Number of events of either polarity at each pixel, [H,W] float32.
torch::Tensor event_density(const EventStream& events, const ImageSize& size);

}  // namespace jade::events
