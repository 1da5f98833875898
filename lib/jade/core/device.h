// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <torch/types.h>

namespace jade {

/// Number of GPUs that this build and this machine can use: 0 without CUDA kernels, driver or GPU.
int cuda_device_count();

/// Why cuda_device_count() is 0, and what to do about it; empty if it is not 0.
std::string cuda_problem();

/// "NVIDIA H200 (139 GiB)" or "CPU, 2 threads".
std::string device_name(torch::Device device);

/// Peak number of bytes that tensors held on the device; on the CPU, the peak resident size of the
/// process.
int64_t peak_memory_bytes(torch::Device device);

/// Free GPU memory, after that of the CUDA context of this process; 0 on the CPU.
int64_t free_memory_bytes(torch::Device device);

/// Limits the tensors of this process on a GPU: a larger request throws c10::OutOfMemoryError. Does
/// nothing on the CPU.
void limit_memory(torch::Device device, int64_t bytes);

/// Limits the CPU to eight threads if `device` is a GPU, unless OMP_NUM_THREADS is set: further
/// threads have little to do and spin while they wait for each other.
void limit_threads_beside(torch::Device device);

/// Leaves two CPU cores, of eight or more, to threads that start a GPU, until destroyed: a team of
/// threads waits for one that finds no core. Does nothing if OMP_NUM_THREADS is set.
class FewerThreads {
 public:
  /// @param fewer  false: does nothing
  explicit FewerThreads(bool fewer);
  ~FewerThreads();
  FewerThreads(const FewerThreads&) = delete;
  FewerThreads& operator=(const FewerThreads&) = delete;

 private:
  int before_;
};

/// Returns cached GPU memory to the driver if the allocator holds more than `keep_bytes` beyond
/// what tensors use. Synchronises the device when it does; does nothing on the CPU. With 0 it also
/// frees the workspaces of matrix products, so no recorded graph may use one.
/// @return number of bytes returned
int64_t trim_device_memory(torch::Device device, int64_t keep_bytes);

/// Creates the GPU's context, which takes tenths of a second; does nothing on the CPU.
void start_device(torch::Device device);

/// Limits the stack of each GPU thread to 256 bytes until the program ends. The default, 1 KiB, is
/// reserved for each of the 270,000 threads that an H100 can run. Kernels whose stack is known to
/// be larger still get it. Initialises the device; only the first call per device has an effect.
/// Does nothing on the CPU.
void bound_stack_memory(torch::Device device);

/// Parses "auto", "cpu", "cuda" or "cuda:N"; auto selects the first GPU, else the CPU.
/// @throws ConfigError for another word, DeviceError if there is no such device.
torch::Device select_device(const std::string& choice);

}  // namespace jade
