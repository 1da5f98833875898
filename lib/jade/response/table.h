// SPDX-License-Identifier: Apache-2.0
// The table of ρ from the network's weights, apart from autograd, in one launch and two back;
// torch's layers take some forty for the same. Their arithmetic is that of
// CameraResponseImpl::exact(), which the CPU uses and tests compare with. Not for use outside this
// room.
#pragma once

#include <ATen/core/Tensor.h>
#include <array>
#include <cstdint>

#include "jade/response/lookup.h"

namespace jade::response {

constexpr int kHidden = 16;

/// Offset of each parameter among all: weight and bias of layer 1, of layer 2, …
constexpr std::array<int, 9> kParameterOffsets = {0, 16, 32, 288, 304, 560, 576, 592, 593};
constexpr int kResponseParameters = 593;

/// [16,1], [16], [16,16], [16], [16,16], [16], [1,16], [1]; contiguous float32 on one GPU.
using NetworkWeights = std::array<at::Tensor, 8>;

namespace cuda {

/// ρ at the knots, [kKnots].
at::Tensor response_table(const NetworkWeights& weights);
/// Gradient of all parameters, [593]. Sums are taken in a fixed order.
/// @param table     what response_table() gave
/// @param of_table  [kKnots]
at::Tensor response_table_gradient(const NetworkWeights& weights, const at::Tensor& table,
                                   const at::Tensor& of_table);

}  // namespace cuda
}  // namespace jade::response
