// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

namespace jade::run {

/// Where a GPU puts the pictures that it drew. Memory that was lent is lent again once nobody holds
/// the picture, and none is given back before the end: pinned memory that another thread frees
/// while a step is being recorded would put a mark into the recording.
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
