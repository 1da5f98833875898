// SPDX-License-Identifier: Apache-2.0
#define JADE_CONV_ISA avx2
#include "jade/router/cpu/conv_kernels_impl.h"

namespace jade::router {

const ConvKernels kAvx2ConvKernels = avx2::make_kernels();

}  // namespace jade::router
