// SPDX-License-Identifier: Apache-2.0
#include "jade/core/cuda_launch.h"

#include <cuda_runtime_api.h>

#include "jade/core/error.h"

namespace jade::cuda {

void check_launch(const char* what) {
  const cudaError_t status = cudaGetLastError();
  if (status == cudaSuccess) return;
  throw DeviceError(concat(what, " failed on the GPU: ", cudaGetErrorString(status),
                           "; try again, or use --device cpu"));
}

}  // namespace jade::cuda
