// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"
#include "jade/scene/adam.h"

namespace jade::scene::cuda {

void adam_step(const AdamStep&) {
  throw DeviceError("this build has no CUDA kernels: configure with -DJADE_CUDA=ON");
}

}  // namespace jade::scene::cuda
