// SPDX-License-Identifier: Apache-2.0
#include "jade/kernel/launch.h"

#include <cstdlib>
#include <cuda_runtime_api.h>

#include "jade/core/error.h"

namespace jade::kernel {

void check_launch(const char* what) {
  static const bool synchronous = [] {
    const char* const value = std::getenv("JADE_CUDA_SYNC");
    return value != nullptr && value[0] == '1';
  }();
  cudaError_t status = cudaGetLastError();
  if (status == cudaSuccess && synchronous) status = cudaDeviceSynchronize();
  if (status == cudaSuccess) return;
  throw DeviceError(concat(what, " failed on the GPU: ", cudaGetErrorString(status),
                           "; try again, or use --device cpu"));
}

}  // namespace jade::kernel
