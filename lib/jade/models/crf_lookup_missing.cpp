// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"
#include "jade/models/crf_lookup.h"

namespace jade::models::cuda {
namespace {

[[noreturn]] void fail() {
  throw DeviceError("this build has no CUDA kernels: configure with -DJADE_CUDA=ON");
}

}  // namespace

torch::Tensor crf_lookup(const CrfLookup&) { fail(); }

CrfGradient crf_lookup_backward(const CrfLookup&, const torch::Tensor&, bool, bool) { fail(); }

}  // namespace jade::models::cuda
