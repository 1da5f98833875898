// SPDX-License-Identifier: Apache-2.0
// Many copies on a GPU in one launch: a step's inputs are some thirty small tensors.
#pragma once

#include <cstdint>
#include <vector>

namespace jade::train {

/// `bytes` bytes from one place of a device to another, of any alignment.
struct BufferCopy {
  const void* from = nullptr;
  void* to = nullptr;
  int64_t bytes = 0;
};

namespace cuda {

/// All copies on the current stream, in a launch for each 64 of them; does not wait. No
/// destination may overlap another buffer. @throws DeviceError.
void copy_all(const std::vector<BufferCopy>& copies);

}  // namespace cuda
}  // namespace jade::train
