// SPDX-License-Identifier: Apache-2.0
// event_loss() without autograd. Private to this folder.
#pragma once

#include <ATen/core/Tensor.h>

#include "jade/losses/event_loss.h"
#include "jade/losses/event_loss_math.h"

namespace jade::losses {

/// Lower bound of the sum of weights by which L_ev is divided.
constexpr double kLeastWeight = 1e-12;

/// Tensors of the pairs: contiguous and of the renders' type, except indices and filter.
/// `residuals` is [P] double, dL_ev/dΔℓ before the division; `weight` [1] double, the divisor of
/// L_ev; `loss` [] of the renders' type.
namespace cpu {  // float or double
void event_loss(const EventPair& events, at::Tensor& loss, at::Tensor& residuals,
                at::Tensor& weight);
/// @param of_loss     [] of the renders' type
/// @param of_renders  [2,3,H,W], all zero
void event_loss_gradient(const EventPair& events, const at::Tensor& residuals,
                         const at::Tensor& weight, const at::Tensor& of_loss,
                         at::Tensor& of_renders);
}  // namespace cpu

namespace cuda {  // float; runs on the current stream without waiting
void event_loss(const EventPair& events, at::Tensor& loss, at::Tensor& residuals,
                at::Tensor& weight);
void event_loss_gradient(const EventPair& events, const at::Tensor& residuals,
                         const at::Tensor& weight, const at::Tensor& of_loss,
                         at::Tensor& of_renders);
}  // namespace cuda

/// @tparam T  of the renders
template <class T>
EventPixels<T> pixels_of(const EventPair& events) {
  EventPixels<T> in{};
  in.plane = events.counts.numel();
  in.before = events.renders.const_data_ptr<T>();
  in.after = in.before + 3 * in.plane;
  in.counts = events.counts.const_data_ptr<T>();
  in.indices = events.pixels.const_data_ptr<int64_t>();
  if (events.color_filter.defined()) in.filter = events.color_filter.const_data_ptr<bool>();
  in.count = events.pixels.numel();
  in.threshold_positive = events.threshold_positive;
  in.threshold_negative = events.threshold_negative;
  in.weighted_colors = events.weighted_colors;
  return in;
}

}  // namespace jade::losses
