// SPDX-License-Identifier: Apache-2.0
#include "jade/core/cuda_runtime.h"

namespace jade::cuda {

int device_count() { return 0; }
std::string problem() {
  return "this program was built without CUDA kernels; build with -DJADE_CUDA=ON where nvcc is "
         "installed";
}
std::string device_name(int) { return "GPU"; }
int64_t peak_memory_bytes(int) { return 0; }
int64_t free_memory_bytes(int) { return 0; }
void limit_memory(int, int64_t) {}
int64_t trim_memory(int, int64_t) { return 0; }
void bound_stack_memory(int) {}

}  // namespace jade::cuda
