// SPDX-License-Identifier: Apache-2.0
#include "jade/kernel/on_cuda.h"

#include "support/catch.h"

using namespace jade;

#ifdef JADE_WITH_CUDA

TEST_CASE("on_cuda: gives what the call gives", "[kernel]") {
  CHECK(kernel::on_cuda("the test", [] { return 7; }) == 7);
  bool called = false;
  kernel::on_cuda("the test", [&] { called = true; });
  CHECK(called);
}

#else

// Not defined anywhere: the test includes that this program links.
int only_on_cuda();

TEST_CASE("on_cuda: a build without CUDA kernels says what it lacks and how to get it",
          "[kernel]") {
  try {
    kernel::on_cuda("the test", [] { return only_on_cuda(); });
    FAIL("expected an error");
  } catch (const DeviceError& error) {
    CHECK(std::string(error.what()) ==
          "the test on a GPU needs CUDA kernels, and this build has none: configure with "
          "-DJADE_CUDA=ON or use --device cpu");
  }
}

#endif
