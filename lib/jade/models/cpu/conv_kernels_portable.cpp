// SPDX-License-Identifier: Apache-2.0
#define JADE_CONV_ISA portable
#include "jade/models/cpu/conv_kernels_impl.h"

namespace jade::models {

const ConvKernels kPortableConvKernels = portable::make_kernels();

}  // namespace jade::models
