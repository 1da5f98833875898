// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/nn/modules/conv.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

namespace jade::router {

/// The Spatial Prior Router R_θ, Eq. (2) and (3): two shallow encoders and a three-layer head,
/// 9,314 parameters (event encoder 3,200, image encoder 2,768, head 3,346). It reads only the
/// measurements, no restoration. All convolutions pad by replication, so that α has no border
/// artefacts.
class RouterImpl : public torch::nn::Module {
 public:
  /// Weights are sampled from `generator`, uniform within ±1/sqrt(fan-in).
  explicit RouterImpl(at::Generator generator);

  /// α in [0,1].
  /// @param input  [N,5,H,W], X_in: B, then Ψ(V), positive and negative events summed over time
  /// @return [N,1,H,W]
  torch::Tensor forward(const torch::Tensor& input);

  /// Input of forward()'s sigmoid: unbounded.
  torch::Tensor logits(const torch::Tensor& input);

  /// Reference for logits() with torch's convolutions, on any device. The kernels of logits() agree
  /// with it up to rounding, on CUDA to 11 bits, and are several times as fast.
  torch::Tensor logits_by_layers(const torch::Tensor& input);

  torch::nn::Conv2d event1{nullptr}, event2{nullptr};                ///< 5×5, 2→16→6, no bias
  torch::nn::Conv2d image1{nullptr}, image2{nullptr};                ///< 5×5, 3→10→8, bias
  torch::nn::Conv2d head1{nullptr}, head2{nullptr}, head3{nullptr};  ///< 3×3, 3×3, 1×1: 17→9→24→1
};
TORCH_MODULE(Router);

}  // namespace jade::router
