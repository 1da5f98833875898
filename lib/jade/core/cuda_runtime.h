// SPDX-License-Identifier: Apache-2.0
// Queries of core/device.cpp to the CUDA runtime; cuda_runtime_missing.cpp implements them in
// CPU-only builds.
#pragma once

#include <cstdint>
#include <string>

namespace jade::cuda {

int device_count();
std::string problem();
std::string device_name(int index);
int64_t peak_memory_bytes(int index);
int64_t free_memory_bytes(int index);
void limit_memory(int index, int64_t bytes);
int64_t trim_memory(int index, int64_t keep_bytes);
void bound_stack_memory(int index);

}  // namespace jade::cuda
