// SPDX-License-Identifier: Apache-2.0
#include "jade/kernel/launch.h"

#include <cstdlib>
#include <cuda_runtime_api.h>

#include "jade/core/error.h"

namespace jade::kernel {

bool waits_for_launches() {
  static const bool waits = [] {
    const char* const value = std::getenv("JADE_CUDA_SYNC");
    return value != nullptr && value[0] == '1';
  }();
  return waits;
}

void check_launch(const char* what) {
  cudaError_t status = cudaGetLastError();
  if (status == cudaSuccess && waits_for_launches()) status = cudaDeviceSynchronize();
  if (status == cudaSuccess) return;
  throw DeviceError(concat(what, " failed on the GPU: ", cudaGetErrorString(status),
                           "; try again, or use --device cpu"));
}

}  // namespace jade::kernel
