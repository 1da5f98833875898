// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"
#include "jade/gaussians/adam.h"

namespace jade::gaussians::cuda {

void adam_step(const AdamStep&) {
  throw DeviceError("this build has no CUDA kernels: configure with -DJADE_CUDA=ON");
}

}  // namespace jade::gaussians::cuda
