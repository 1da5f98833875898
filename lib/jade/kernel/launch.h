// SPDX-License-Identifier: Apache-2.0
// For files that are compiled with CUDA kernels only.
#pragma once

#include <cstdint>

#include "jade/kernel/host_device.h"

namespace jade::kernel {

/// How many blocks of `size` cover `count`.
JADE_HD constexpr int64_t block_count(int64_t count, int64_t size) {
  return (count + size - 1) / size;
}

/// block_count() as a grid dimension. CUDA refuses values that do not fit: see check_launch().
inline unsigned grid_size(int64_t count, int64_t size) {
  return static_cast<unsigned>(block_count(count, size));
}

/// Whether the environment has JADE_CUDA_SYNC=1. Then nothing can be recorded as a CUDA graph.
bool waits_for_launches();

/// To be called after kernels were launched; does not wait for them, unless
/// waits_for_launches(): then it reports the faults of these kernels too.
/// @param what  the work, "the Adam step"
/// @throws DeviceError when one did not start, or when the GPU reports the failure of an earlier
///   one.
void check_launch(const char* what);

}  // namespace jade::kernel
