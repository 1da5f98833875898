// SPDX-License-Identifier: Apache-2.0
// Many copies on a GPU in one launch: a step's inputs are about thirty small tensors.
#pragma once

#include <cstdint>
#include <vector>

namespace jade::train {

/// Copies `bytes` bytes on one device, with any alignment.
struct BufferCopy {
  const void* from = nullptr;
  void* to = nullptr;
  int64_t bytes = 0;
};

namespace cuda {

/// Runs all copies on the current stream, one launch per 64 of them; does not wait. No destination
/// may overlap another buffer.
/// @throws DeviceError.
void copy_all(const std::vector<BufferCopy>& copies);

}  // namespace cuda
}  // namespace jade::train
