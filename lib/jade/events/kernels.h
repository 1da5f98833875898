// SPDX-License-Identifier: Apache-2.0
// What counts.cpp asks of cuda/count.cu; cuda/count_missing.cpp answers in CPU-only builds.
#pragma once

#include <cstdint>
#include <vector>

namespace jade::events {

/// Arrays of one stream and the sums to fill; `out` is zeroed.
struct CountArguments {
  const float* x = nullptr;
  const float* y = nullptr;
  const int8_t* polarity = nullptr;
  const std::vector<int64_t>* bounds = nullptr;  ///< S + 1 event indices, on the host
  int32_t width = 0, height = 0;
  int64_t* out = nullptr;  ///< [S,2,H,W]
};

/// Runs on the current CUDA stream of the device and does not wait for it.
/// @throws DeviceError without CUDA kernels and when the launch fails.
void count_cuda(const CountArguments& arguments, int device_index);

}  // namespace jade::events
