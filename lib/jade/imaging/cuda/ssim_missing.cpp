// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"
#include "jade/imaging/ssim_kernels.h"

namespace jade::imaging {

int64_t ssim_cuda_blocks(int64_t, int64_t, int64_t) { return 0; }

void ssim_cuda(const SsimCuda&, const double*, int) {
  throw DeviceError(
      "SSIM on a GPU needs CUDA kernels, and this build has none: configure with -DJADE_CUDA=ON");
}

}  // namespace jade::imaging
