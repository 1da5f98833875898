// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"
#include "jade/splat/backend.h"

namespace jade::splat::cuda {

namespace {
[[noreturn]] void fail() {
  throw DeviceError(
      "splatting on a GPU needs CUDA kernels, and this build has none: configure with "
      "-DJADE_CUDA=ON or use --device cpu");
}
}  // namespace

ForwardResult forward(const ForwardArgs&) { fail(); }

BackwardResult backward(const BackwardArgs&) { fail(); }

}  // namespace jade::splat::cuda
