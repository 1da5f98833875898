// SPDX-License-Identifier: Apache-2.0
// Eq. (4) at one value of the image, shared by CPU and CUDA.
#pragma once

#include "jade/kernel/host_device.h"

namespace jade::restore {

/// F + α (I_edi − F), which is exactly F, without gradient by α, where both are equal.
template <class T>
JADE_HD T fused(T alpha, T edi, T efnet) {
  return efnet + alpha * (edi - efnet);
}

/// d fused / dα, a factor of Eq. (5).
template <class T>
JADE_HD T fused_by_alpha(T edi, T efnet) {
  return edi - efnet;
}

}  // namespace jade::restore
