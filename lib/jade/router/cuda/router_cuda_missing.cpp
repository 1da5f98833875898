// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"
#include "jade/router/cuda/router_cuda.h"

namespace jade::router::cuda {

torch::Tensor conv_layer(const torch::Tensor&, const torch::Tensor&, const torch::Tensor&, bool) {
  throw DeviceError("this build has no CUDA kernels: configure with -DJADE_CUDA=ON");
}

}  // namespace jade::router::cuda
