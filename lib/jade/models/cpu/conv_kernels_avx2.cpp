// SPDX-License-Identifier: Apache-2.0
#define JADE_CONV_ISA avx2
#include "jade/models/cpu/conv_kernels_impl.h"

namespace jade::models {

const ConvKernels kAvx2ConvKernels = avx2::make_kernels();

}  // namespace jade::models
