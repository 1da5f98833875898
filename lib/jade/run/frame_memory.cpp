// SPDX-License-Identifier: Apache-2.0
#include "jade/run/frame_memory.h"

#include <c10/util/accumulate.h>
#include <torch/types.h>

namespace jade::run {

torch::Tensor FrameMemory::lend(torch::IntArrayRef sizes, bool pinned) {
  const int64_t numel = c10::multiply_integers(sizes);
  for (const torch::Tensor& memory : lent_) {
    if (memory.numel() >= numel && memory.storage().use_count() == 1) {
      return memory.narrow(0, 0, numel).view(sizes);
    }
  }
  lent_.push_back(torch::empty({numel}, torch::dtype(torch::kFloat32).pinned_memory(pinned)));
  return lent_.back().view(sizes);
}

}  // namespace jade::run
