// SPDX-License-Identifier: Apache-2.0
// Only for files that are compiled with CUDA kernels.
#pragma once

#include <cstdint>

#include "jade/kernel/host_device.h"

namespace jade::kernel {

/// Number of blocks of `size` that cover `count`.
JADE_HD constexpr int64_t block_count(int64_t count, int64_t size) {
  return (count + size - 1) / size;
}

/// block_count() as a grid dimension. CUDA rejects values that do not fit: see check_launch().
inline unsigned grid_size(int64_t count, int64_t size) {
  return static_cast<unsigned>(block_count(count, size));
}

/// Whether the environment sets JADE_CUDA_SYNC=1. Then nothing can be captured in a CUDA graph.
bool waits_for_launches();

/// Call after launching kernels. Does not wait for them, unless waits_for_launches(): then it also
/// reports the faults of these kernels.
/// @param what  the work, "the Adam step"
/// @throws DeviceError if a kernel did not start, or if the GPU reports the failure of an earlier
///   one.
void check_launch(const char* what);

}  // namespace jade::kernel
