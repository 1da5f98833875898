// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <torch/types.h>

namespace jade {

/// GPUs that this build and this machine can use: 0 without CUDA kernels, driver or card.
int cuda_device_count();

/// Why cuda_device_count() is 0, with what to do about it; empty when it is not.
std::string cuda_problem();

/// "NVIDIA H200 (139 GiB)" or "CPU, 2 threads".
std::string device_name(torch::Device device);

/// Bytes that tensors hold on the device at their highest so far; on the CPU the process's peak
/// resident size.
int64_t peak_memory_bytes(torch::Device device);

/// Limits the CPU to eight threads when a GPU does the work, unless OMP_NUM_THREADS is set: more
/// threads have little to do and spin while they wait for each other.
void limit_threads_beside(torch::Device device);

/// Gives memory back to a GPU's other users where the allocator keeps more than `keep_bytes` beyond
/// what tensors hold. Waits for the device when it does; nothing on the CPU.
/// @return bytes given back
int64_t trim_device_memory(torch::Device device, int64_t keep_bytes);

/// Has the driver keep 256 bytes for the stack of each of a GPU's threads, until the program ends:
/// unasked it takes 1 KiB for each of the 270,000 that an H100 can run. A kernel that is known to
/// need more still gets it. Starts the device; only the first call for it acts. Nothing on the CPU.
void bound_stack_memory(torch::Device device);

/// Reads "auto", "cpu", "cuda" or "cuda:N"; auto takes the first GPU, else the CPU.
/// @throws ConfigError for another word, DeviceError if there is no such device.
torch::Device select_device(const std::string& choice);

}  // namespace jade
