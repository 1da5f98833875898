// SPDX-License-Identifier: Apache-2.0
// Eq. (4) at one value of the image: for the CPU and for CUDA alike.
#pragma once

#include "jade/kernel/host_device.h"

namespace jade::restore {

/// F + α (I_edi − F), which is F, and without a gradient to α, wherever both agree.
template <class T>
JADE_HD T fused(T alpha, T edi, T efnet) {
  return efnet + alpha * (edi - efnet);
}

/// d fused / dα, of which Eq. (5) is made.
template <class T>
JADE_HD T fused_by_alpha(T edi, T efnet) {
  return edi - efnet;
}

}  // namespace jade::restore
