// SPDX-License-Identifier: Apache-2.0
#define JADE_SPLAT_ISA portable
#include "jade/splat/cpu/kernels_impl.h"

namespace jade::splat::cpu {

const KernelSet kPortableKernels = {make_kernels<math::Pack<float, 4>>("portable"),
                                    make_kernels<math::Pack<double, 2>>("portable")};

}  // namespace jade::splat::cpu
