// SPDX-License-Identifier: Apache-2.0
#define JADE_SSIM_ISA avx2
#include "jade/imaging/cpu/ssim_band_impl.h"

namespace jade::imaging {

const SsimKernels kAvx2SsimKernels = avx2::make_kernels();

}  // namespace jade::imaging
