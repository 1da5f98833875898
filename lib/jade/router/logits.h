// SPDX-License-Identifier: Apache-2.0
// The router's seven layers, from its inputs to its logits. Private to this folder.
#pragma once

#include <torch/types.h>

namespace jade::router {

struct RouterWeights {
  torch::Tensor event1, event2;                            ///< [16,2,5,5], [6,16,5,5]
  torch::Tensor image1, image1_bias, image2, image2_bias;  ///< [10,3,5,5], [8,10,5,5]
  torch::Tensor head1, head2;                              ///< [9,17,3,3], [24,9,3,3]
  torch::Tensor head3, head3_bias;                         ///< [1,24,1,1]
};

namespace cpu {

/// One operation for all layers. Differentiable once, in every weight and the input. float or
/// double, all tensors of one type. Any number of threads gives the same bits.
/// @param input  [N,5,H,W], X_in
/// @return [N,1,H,W]
torch::Tensor router_logits(const torch::Tensor& input, const RouterWeights& weights);

}  // namespace cpu

namespace cuda {

/// CUDA version of router_logits(). float32 only. Factors of products are rounded to 11 bits, as by
/// torch's convolutions in TF32, and summed in float32 (README.md).
/// @throws ContractError for other shapes or types, DeviceError if a kernel does not start.
torch::Tensor router_logits(const torch::Tensor& input, const RouterWeights& weights);

}  // namespace cuda

}  // namespace jade::router
