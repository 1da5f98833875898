// SPDX-License-Identifier: Apache-2.0
// Kernels that cannot start.
#include "support/catch.h"

#include <cuda_runtime_api.h>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/models/crf_lookup.h"
#include "jade/models/cuda/router_cuda.h"

namespace jade::models {
namespace {

TEST_CASE("router: a batch beyond CUDA's grid is a DeviceError", "[models][cuda]") {
  const auto options = torch::TensorOptions(torch::kCUDA);
  const torch::Tensor weights = torch::zeros({16, 2, 5, 5}, options);
  CHECK_NOTHROW(cuda::conv_layer(torch::zeros({2, 2, 1, 1}, options), weights, {}, true));
  CHECK_THROWS_AS(cuda::conv_layer(torch::zeros({70000, 2, 1, 1}, options), weights, {}, true),
                  DeviceError);
}

TEST_CASE("crf: a failure that CUDA reports is a DeviceError", "[models][cuda]") {
  const auto options = torch::TensorOptions(torch::kCUDA);
  const CrfLookup args{torch::zeros({2, 5}, options), torch::zeros({kCrfKnots}, options)};
  const auto forward = [&] { cuda::crf_lookup(args); };
  const auto backward = [&] { cuda::crf_lookup_backward(args, args.image, true, false); };
  CHECK_NOTHROW(forward());
  CHECK_NOTHROW(backward());
  // Its launches fit any image, so the failure comes from a device that no machine has; the table's
  // gradient would meet torch's own checks first.
  REQUIRE(cudaSetDevice(1 << 20) != cudaSuccess);
  CHECK_THROWS_AS(forward(), DeviceError);
  REQUIRE(cudaSetDevice(1 << 20) != cudaSuccess);
  CHECK_THROWS_AS(backward(), DeviceError);
}

}  // namespace
}  // namespace jade::models
