// SPDX-License-Identifier: Apache-2.0
// Kernels that cannot start.
#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/router/cuda/router_cuda.h"

namespace jade::router {
namespace {

TEST_CASE("router: a batch beyond CUDA's grid is a DeviceError", "[router][cuda]") {
  const auto options = torch::TensorOptions(torch::kCUDA);
  const torch::Tensor weights = torch::zeros({16, 2, 5, 5}, options);
  CHECK_NOTHROW(cuda::conv_layer(torch::zeros({2, 2, 1, 1}, options), weights, {}, true));
  CHECK_THROWS_AS(cuda::conv_layer(torch::zeros({70000, 2, 1, 1}, options), weights, {}, true),
                  DeviceError);
}

}  // namespace
}  // namespace jade::router
