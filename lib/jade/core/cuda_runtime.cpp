// SPDX-License-Identifier: Apache-2.0
#include "jade/core/cuda_runtime.h"

#include <ATen/Context.h>
#include <ATen/cuda/CUDAContextLight.h>
#include <algorithm>
#include <c10/cuda/CUDACachingAllocator.h>
#include <c10/cuda/CUDAGuard.h>
#include <cuda_runtime_api.h>
#include <mutex>
#include <set>

#include "jade/core/error.h"

namespace jade::cuda {

int device_count() {
  int count = 0;
  // Calls the runtime directly: torch prints a warning if there is no driver.
  return cudaGetDeviceCount(&count) == cudaSuccess ? count : 0;
}

std::string problem() {
  int count = 0;
  const cudaError_t status = cudaGetDeviceCount(&count);
  if (status == cudaSuccess && count > 0) return "";
  if (status == cudaErrorInsufficientDriver) {
    int driver = 0;
    cudaDriverGetVersion(&driver);
    if (driver == 0) return "no NVIDIA driver was found; install one";
    return concat("the NVIDIA driver knows CUDA ", driver / 1000, ".", driver % 1000 / 10,
                  ", this program needs ", CUDART_VERSION / 1000, ".", CUDART_VERSION % 1000 / 10,
                  "; update the driver");
  }
  if (status == cudaErrorNoDevice || status == cudaSuccess)
    return "no GPU was found on this machine";
  return concat("CUDA does not start: ", cudaGetErrorString(status));
}

std::string device_name(int index) {
  cudaDeviceProp properties{};
  if (cudaGetDeviceProperties(&properties, index) != cudaSuccess) return "GPU";
  return concat(properties.name, " (", properties.totalGlobalMem >> 30, " GiB)");
}

int64_t peak_memory_bytes(int index) {
  namespace allocator = c10::cuda::CUDACachingAllocator;
  const auto statistics = allocator::getDeviceStats(static_cast<c10::DeviceIndex>(index));
  return statistics.allocated_bytes[0].peak;
}

int64_t free_memory_bytes(int index) {
  const c10::cuda::CUDAGuard guard(static_cast<c10::DeviceIndex>(index));
  size_t free = 0, total = 0;
  return cudaMemGetInfo(&free, &total) == cudaSuccess ? static_cast<int64_t>(free) : 0;
}

void limit_memory(int index, int64_t bytes) {
  const auto device = static_cast<c10::DeviceIndex>(index);
  cudaDeviceProp properties{};
  if (cudaGetDeviceProperties(&properties, index) != cudaSuccess) return;
  const double share = static_cast<double>(bytes) / static_cast<double>(properties.totalGlobalMem);
  at::globalContext().lazyInitDevice(c10::DeviceType::CUDA);
  c10::cuda::CUDACachingAllocator::setMemoryFraction(std::min(1.0, share), device);
}

int64_t trim_memory(int index, int64_t keep_bytes) {
  namespace allocator = c10::cuda::CUDACachingAllocator;
  const auto device = static_cast<c10::DeviceIndex>(index);
  if (keep_bytes == 0) at::cuda::clearCublasWorkspaces();
  const auto before = allocator::getDeviceStats(device);
  const int64_t reserved = before.reserved_bytes[0].current;
  if (reserved - before.allocated_bytes[0].current <= keep_bytes) return 0;
  allocator::emptyCache();
  return reserved - allocator::getDeviceStats(device).reserved_bytes[0].current;
}

void bound_stack_memory(int index) {
  constexpr size_t kBytes = 256;  // per thread; a smaller stack saves little more
  static std::mutex mutex;
  static std::set<int> bounded;
  const std::lock_guard<std::mutex> lock(mutex);
  if (!bounded.insert(index).second) return;
  const c10::cuda::CUDAGuard guard(static_cast<c10::DeviceIndex>(index));
  // A refusal is harmless; clear the error so that it is not attributed to a kernel.
  if (cudaDeviceSetLimit(cudaLimitStackSize, kBytes) != cudaSuccess) cudaGetLastError();
}

}  // namespace jade::cuda
