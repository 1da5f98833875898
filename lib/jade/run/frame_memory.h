// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

namespace jade::run {

/// Pool of page-locked host buffers for pictures from a GPU. A buffer is reused once its picture is
/// released. Buffers are freed only at the end: freeing pinned memory on another thread while a
/// step is captured would record an event.
class FrameMemory {
 public:
  /// Returns an unused float32 tensor of these sizes on the CPU. Call it on the rendering thread.
  /// @param pinned  for asynchronous copies from a GPU
  torch::Tensor lend(torch::IntArrayRef sizes, bool pinned);

  /// Number of allocated pictures.
  size_t count() const { return lent_.size(); }

 private:
  std::vector<torch::Tensor> lent_;  // one-dimensional
};

}  // namespace jade::run
