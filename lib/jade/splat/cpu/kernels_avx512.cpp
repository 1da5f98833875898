// SPDX-License-Identifier: Apache-2.0
#define JADE_SPLAT_ISA avx512
#include "jade/splat/cpu/kernels_impl.h"

namespace jade::splat::cpu {

const KernelSet kAvx512Kernels = {make_kernels<math::Pack<float, 8>>("avx512"),
                                  make_kernels<math::Pack<double, 4>>("avx512")};

}  // namespace jade::splat::cpu
