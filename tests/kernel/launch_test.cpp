// SPDX-License-Identifier: Apache-2.0
#include "jade/kernel/launch.h"

#include "support/catch.h"

#include <cuda_runtime_api.h>

#include "jade/core/error.h"
#include "support/devices.h"
#include "support/naming.h"

using namespace jade;

TEST_CASE("launch: blocks cover what they are given", "[kernel]") {
  CHECK(kernel::block_count(0, 256) == 0);
  CHECK(kernel::block_count(1, 256) == 1);
  CHECK(kernel::block_count(256, 256) == 1);
  CHECK(kernel::block_count(257, 256) == 2);
  CHECK(kernel::grid_size(int64_t{1} << 32, 256) == 1u << 24);
}

TEST_CASE("check_launch: what CUDA refuses is a DeviceError with its reason, once", "[kernel]") {
  cudaGetLastError();
  if (test::has_gpu()) CHECK_NOTHROW(kernel::check_launch("the test"));
  // No machine has this device, and some have no driver: both fail.
  REQUIRE(cudaSetDevice(1 << 20) != cudaSuccess);
  try {
    kernel::check_launch("the test");
    FAIL("expected an error");
  } catch (const DeviceError& error) {
    CHECK(error.exit_code() == ExitCode::kDevice);
    CHECK_THAT(error.what(), test::naming("the test", "GPU"));
  }
  if (test::has_gpu()) CHECK_NOTHROW(kernel::check_launch("the test"));
}
