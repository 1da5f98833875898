// SPDX-License-Identifier: Apache-2.0
// For files that are compiled with CUDA kernels only.
#pragma once

namespace jade::cuda {

/// To be called after kernels were launched; does not wait for them.
/// @param what  the work, "the Adam step"
/// @throws DeviceError when one did not start, or when the GPU reports the failure of an earlier
///   one.
void check_launch(const char* what);

}  // namespace jade::cuda
