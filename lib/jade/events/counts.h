// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/events/event_stream.h"

namespace jade::events {

/// First whole microsecond at or after begin + duration · k / parts, the k-th of parts + 1
/// equidistant knots; k < 0 and k > parts extrapolate outside the window. An event at time t
/// belongs to part k if knot_k ≤ t < knot_{k+1}, exactly.
int64_t knot_us(const TimeWindow& window, int64_t k, int64_t parts);

/// Bilinear sums of positive and negative events in consecutive time spans,
///     P_s(r, c) = Σ_i max(0, 1 − |x_i − c|) · max(0, 1 − |y_i − r|),  knots_s ≤ t_i < knots_{s+1}.
///     One pass over the events; pixel centres have integer coordinates. Weights outside the image
///     are dropped; events that touch no pixel and NaN coordinates are ignored. Any number of
///     threads, CPU and CUDA give the same bits.
/// @param knots_us  S + 1 times, not decreasing.
/// @return [S,2,H,W] int64 on the events' device, positive first, in units of 2⁻³⁰ events.
torch::Tensor count_events(const EventStream& events, const std::vector<int64_t>& knots_us,
                           const ImageSize& size);

/// Converts counts to float32 numbers of events.
torch::Tensor to_events(const torch::Tensor& counts);

/// Σ polarity over all events of the stream, [H,W] float32, for the event loss.
torch::Tensor signed_count(const EventStream& events, const ImageSize& size);

/// Number of events of either polarity at each pixel, [H,W] float32.
torch::Tensor event_density(const EventStream& events, const ImageSize& size);

}  // namespace jade::events
