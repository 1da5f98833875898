// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::gaussians {

/// A parameter in the form that files store: detached, on the CPU, contiguous, of one type.
inline torch::Tensor file_tensor(const torch::Tensor& parameter,
                                 torch::ScalarType type = torch::kFloat32) {
  return parameter.detach().to(torch::kCPU, type).contiguous();
}

}  // namespace jade::gaussians
