// SPDX-License-Identifier: Apache-2.0
#include "jade/train/batch_copy.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/kernel/on_cuda.h"

using namespace jade;

TEST_CASE("batch copy: any number of buffers of any size and alignment arrive, and nothing beside",
          "[train][cuda]") {
  const auto bytes = torch::TensorOptions(torch::kUInt8).device(torch::kCUDA);
  const auto count = GENERATE(int64_t{1}, int64_t{64}, int64_t{150});
  constexpr int64_t kRoom = 70000;
  torch::manual_seed(1);
  const torch::Tensor from = torch::randint(1, 256, {count, kRoom}, bytes);
  torch::Tensor to = torch::zeros({count, kRoom}, bytes);
  torch::Tensor expected = torch::zeros({count, kRoom}, bytes);
  std::vector<train::BufferCopy> copies;
  for (int64_t i = 0; i < count; ++i) {
    // Aligned to 16, to 4 and to nothing; sizes from none to several blocks.
    const int64_t source = 4 * (i % 3), target = i % 5 == 4 ? 1 : 4 * (i % 4);
    const int64_t size = i % 7 == 6 ? 0 : (i * 9973) % (kRoom - 32);
    copies.push_back({from.data_ptr<uint8_t>() + i * kRoom + source,
                      to.data_ptr<uint8_t>() + i * kRoom + target, size});
    expected[i].narrow(0, target, size).copy_(from[i].narrow(0, source, size));
  }
  kernel::on_cuda("the copies", [&] { train::cuda::copy_all(copies); });
  CHECK(to.equal(expected));
  kernel::on_cuda("the copies", [&] { train::cuda::copy_all({}); });
}
