// SPDX-License-Identifier: Apache-2.0
#define JADE_SPLAT_ISA avx2
#include "jade/splat/cpu/kernels_impl.h"

namespace jade::splat::cpu {

const KernelSet kAvx2Kernels = {make_kernels<math::Pack<float, 8>>("avx2"),
                                make_kernels<math::Pack<double, 4>>("avx2")};

}  // namespace jade::splat::cpu
