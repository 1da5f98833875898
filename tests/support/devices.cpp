// SPDX-License-Identifier: Apache-2.0
#include "support/devices.h"

#include <torch/torch.h>

namespace jade::test {

bool has_gpu() {
#ifdef JADE_WITH_CUDA
  return torch::cuda::is_available();
#else
  return false;
#endif
}

}  // namespace jade::test
