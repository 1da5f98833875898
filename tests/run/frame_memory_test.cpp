// SPDX-License-Identifier: Apache-2.0
#include "jade/run/frame_memory.h"

#include "support/catch.h"

using namespace jade;

TEST_CASE("frame memory: what nobody holds is lent again", "[run]") {
  run::FrameMemory memory;
  torch::Tensor first = memory.lend({3, 4, 5}, false);
  const void* const place = first.const_data_ptr();
  const torch::Tensor held = first.narrow(0, 1, 2);
  first = torch::Tensor();
  const torch::Tensor second = memory.lend({3, 4, 5}, false);
  CHECK(second.const_data_ptr() != place);  // a part of it is still held
  CHECK(memory.count() == 2);
}

TEST_CASE("frame memory: a smaller picture takes the place of a larger one", "[run]") {
  run::FrameMemory memory;
  const void* place = nullptr;
  {
    const torch::Tensor first = memory.lend({3, 4, 5}, false);
    place = first.const_data_ptr();
  }
  {
    const torch::Tensor smaller = memory.lend({1, 4, 5}, false);
    CHECK(smaller.sizes() == torch::IntArrayRef({1, 4, 5}));
    CHECK(smaller.const_data_ptr() == place);
  }
  CHECK(memory.lend({3, 40, 50}, false).sizes() == torch::IntArrayRef({3, 40, 50}));
  CHECK(memory.count() == 2);
}
