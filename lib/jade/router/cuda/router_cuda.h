// SPDX-License-Identifier: Apache-2.0
// One layer of the router on CUDA. Not for use outside this module.
#pragma once

#include <torch/types.h>

namespace jade::router::cuda {

/// relu(bias + w * replicate_pad(in)) for the router's seven layer shapes. Differentiable once.
/// float32 only; no TF32. The same bits every time.
/// @param in       [N,C,H,W]
/// @param weights  [O,C,K,K]
/// @param bias     [O], or undefined.
/// @throws ContractError for other shapes or types, DeviceError without CUDA kernels and when one
/// does not start.
torch::Tensor conv_layer(const torch::Tensor& in, const torch::Tensor& weights,
                         const torch::Tensor& bias, bool relu);

}  // namespace jade::router::cuda
