// SPDX-License-Identifier: Apache-2.0
// Kernels that cannot start.
#include "support/catch.h"

#include <cuda_runtime_api.h>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/response/lookup.h"

namespace jade::response {
namespace {

TEST_CASE("camera response: a failure that CUDA reports is a DeviceError", "[response][cuda]") {
  const auto options = torch::TensorOptions(torch::kCUDA);
  const Lookups args{{{torch::zeros({2, 5}, options), {}}}, torch::zeros({kKnots}, options)};
  const auto forward = [&] { cuda::lookup(args); };
  const auto backward = [&] {
    cuda::lookup_backward(args, {args.images[0].image}, {{true}, false});
  };
  CHECK_NOTHROW(forward());
  CHECK_NOTHROW(backward());
  // Its launches fit any image, so cause the failure by a device that no machine has; the table's
  // gradient would fail in torch's own checks first.
  REQUIRE(cudaSetDevice(1 << 20) != cudaSuccess);
  CHECK_THROWS_AS(forward(), DeviceError);
  REQUIRE(cudaSetDevice(1 << 20) != cudaSuccess);
  CHECK_THROWS_AS(backward(), DeviceError);
}

}  // namespace
}  // namespace jade::response
