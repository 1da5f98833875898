// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"
#include "jade/events/kernels.h"

namespace jade::events {

void count_cuda(const CountArguments&, int) {
  throw DeviceError(
      "events on a GPU need CUDA kernels, and this build has none: configure with -DJADE_CUDA=ON");
}

}  // namespace jade::events
