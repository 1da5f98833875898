// SPDX-License-Identifier: Apache-2.0
#include "jade/core/cuda_launch.h"

#include "support/catch.h"

#include <cuda_runtime_api.h>

#include "jade/core/error.h"
#include "support/devices.h"

using namespace jade;

TEST_CASE("check_launch: what CUDA refuses is a DeviceError with its reason, once", "[core]") {
  cudaGetLastError();
  if (test::has_gpu()) CHECK_NOTHROW(cuda::check_launch("the test"));
  // No machine has this device, and some have no driver to ask: a failure on each.
  REQUIRE(cudaSetDevice(1 << 20) != cudaSuccess);
  try {
    cuda::check_launch("the test");
    FAIL("expected an error");
  } catch (const DeviceError& error) {
    CHECK(error.exit_code() == ExitCode::kDevice);
    CHECK_THAT(error.what(), Catch::Contains("the test failed on the GPU: "));
  }
  if (test::has_gpu()) CHECK_NOTHROW(cuda::check_launch("the test"));
}
