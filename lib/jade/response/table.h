// SPDX-License-Identifier: Apache-2.0
// The table of ρ from the network's weights, without autograd, in one launch and two for the
// gradient; torch's layers need about forty. The arithmetic is that of CameraResponseImpl::exact(),
// which the CPU uses and tests compare with. Private to this folder.
#pragma once

#include <ATen/core/Tensor.h>
#include <array>
#include <cstdint>

#include "jade/response/lookup.h"

namespace jade::response {

constexpr int kHidden = 16;

/// Offset of each parameter in the concatenation: weight and bias of layer 1, of layer 2, …
constexpr std::array<int, 9> kParameterOffsets = {0, 16, 32, 288, 304, 560, 576, 592, 593};
constexpr int kResponseParameters = 593;

/// [16,1], [16], [16,16], [16], [16,16], [16], [1,16], [1]; contiguous float32 on one GPU.
using NetworkWeights = std::array<at::Tensor, 8>;

namespace cuda {

/// ρ at the knots, [kKnots].
at::Tensor response_table(const NetworkWeights& weights);
/// Gradient of all parameters, [593]. Sums are in a fixed order.
/// @param table     result of response_table()
/// @param of_table  [kKnots]
at::Tensor response_table_gradient(const NetworkWeights& weights, const at::Tensor& table,
                                   const at::Tensor& of_table);

}  // namespace cuda
}  // namespace jade::response
