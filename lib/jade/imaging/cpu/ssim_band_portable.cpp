// SPDX-License-Identifier: Apache-2.0
#define JADE_SSIM_ISA portable
#include "jade/imaging/cpu/ssim_band_impl.h"

namespace jade::imaging {

const SsimKernels kPortableSsimKernels = portable::make_kernels();

}  // namespace jade::imaging
