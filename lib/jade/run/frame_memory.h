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
  /// A float32 tensor of these sizes on the CPU that nobody else holds. On the thread that draws.
  /// @param pinned  for copies that a GPU makes by itself
  torch::Tensor lend(torch::IntArrayRef sizes, bool pinned);

  /// Pictures that there is memory for.
  size_t count() const { return lent_.size(); }

 private:
  std::vector<torch::Tensor> lent_;  // flat
};

}  // namespace jade::run
