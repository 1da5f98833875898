// SPDX-License-Identifier: Apache-2.0
// The router's layers by torch's convolutions in float64, with operands rounded as its CUDA kernels
// round them.
#pragma once

#include <torch/csrc/autograd/custom_function.h>
#include <torch/nn/functional.h>
#include <torch/types.h>
#include <vector>

#include "jade/router/logits.h"

namespace jade::router {

/// To 11 bits, as half precision.
inline torch::Tensor rounded(const torch::Tensor& x) {
  const auto [mantissa, exponent] = torch::frexp(x.detach());
  const torch::Tensor value = torch::ldexp((mantissa * 2048).round(), exponent - 11);
  return x + (value - x.detach());
}

/// Its argument, whose gradient is rounded.
class RoundedGradient : public torch::autograd::Function<RoundedGradient> {
 public:
  static torch::Tensor forward(torch::autograd::AutogradContext*, const torch::Tensor& x) {
    return x.view_as(x);
  }
  static std::vector<torch::Tensor> backward(torch::autograd::AutogradContext*,
                                             std::vector<torch::Tensor> gradients) {
    return {rounded(gradients[0])};
  }
};

/// A convolution and its ReLU. Both operands and the gradient of the sums are rounded.
inline torch::Tensor rounded_layer(const torch::Tensor& in, const torch::Tensor& weights,
                                   const torch::Tensor& bias) {
  namespace F = torch::nn::functional;
  const int64_t border = weights.size(2) / 2;
  const torch::Tensor padded = F::pad(
      rounded(in), F::PadFuncOptions({border, border, border, border}).mode(torch::kReplicate));
  return RoundedGradient::apply(torch::conv2d(padded, rounded(weights), bias)).relu();
}

/// Only the gradients of the last layer's weights use rounded operands.
inline torch::Tensor rounded_last_layer(const torch::Tensor& in, const torch::Tensor& weights,
                                        const torch::Tensor& bias) {
  const torch::Tensor of_input = torch::conv2d(in, weights.detach(), bias.detach());
  const torch::Tensor of_weights =
      RoundedGradient::apply(torch::conv2d(rounded(in.detach()), weights, bias));
  return of_input + (of_weights - of_weights.detach());
}

/// Reference of cuda::router_logits(), in float64.
inline torch::Tensor rounded_logits(const torch::Tensor& input, const RouterWeights& w) {
  const torch::Tensor blurry = input.narrow(1, 0, 3), psi = input.narrow(1, 3, 2);
  const torch::Tensor events = rounded_layer(rounded_layer(psi, w.event1, {}), w.event2, {});
  const torch::Tensor image =
      rounded_layer(rounded_layer(blurry, w.image1, w.image1_bias), w.image2, w.image2_bias);
  const torch::Tensor hidden = rounded_layer(torch::cat({blurry, events, image}, 1), w.head1, {});
  return rounded_last_layer(rounded_layer(hidden, w.head2, {}), w.head3, w.head3_bias);
}

/// Whole numbers in [least, most]: with them the layers' sums are exact in float32, so that both
/// sides round the same numbers, and no unit is on the other side of ReLU's kink.
inline torch::Tensor whole(int64_t least, int64_t most, const std::vector<int64_t>& shape) {
  return torch::randint(least, most + 1, shape, torch::kFloat32);
}

}  // namespace jade::router
