// SPDX-License-Identifier: Apache-2.0
#define JADE_CONV_ISA portable
#include "jade/router/cpu/conv_kernels_impl.h"

namespace jade::router {

const ConvKernels kPortableConvKernels = portable::make_kernels();

}  // namespace jade::router
