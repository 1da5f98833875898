// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"
#include "jade/response/lookup.h"

namespace jade::response::cuda {
namespace {

[[noreturn]] void fail() {
  throw DeviceError("this build has no CUDA kernels: configure with -DJADE_CUDA=ON");
}

}  // namespace

torch::Tensor lookup(const Lookup&) { fail(); }

LookupGradient lookup_backward(const Lookup&, const torch::Tensor&, bool, bool) { fail(); }

}  // namespace jade::response::cuda
