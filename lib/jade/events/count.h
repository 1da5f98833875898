// SPDX-License-Identifier: Apache-2.0
// Sums of events over plain pointers; count_math.h has their arithmetic. Private to this folder:
// others use counts.h.
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

namespace cpu {
void count(const CountArguments& arguments);
}

namespace cuda {
/// Runs on the current stream of the device, without waiting.
/// @throws DeviceError if it does not start.
void count(const CountArguments& arguments, int device_index);
}  // namespace cuda

}  // namespace jade::events
