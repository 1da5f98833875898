// SPDX-License-Identifier: Apache-2.0
#include "jade/core/version.h"

#include <torch/version.h>

#include "jade_version.inc"

#ifdef JADE_WITH_CUDA
#include <cuda_runtime_api.h>
#endif

namespace jade {

std::string version() { return JADE_VERSION; }

std::string git_commit() { return JADE_GIT_COMMIT; }

std::string torch_version() { return TORCH_VERSION; }

std::string cuda_version() {
#ifdef JADE_WITH_CUDA
  return std::to_string(CUDART_VERSION / 1000) + "." + std::to_string(CUDART_VERSION % 1000 / 10);
#else
  return "none";
#endif
}

}  // namespace jade
