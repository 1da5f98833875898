// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/smallest_three.h"

namespace jade::gaussians {
namespace {

/// [N,3]: the components except the given one.
torch::Tensor remaining(const torch::Tensor& largest) {
  const torch::Tensor table =
      torch::tensor({1, 2, 3, 0, 2, 3, 0, 1, 3, 0, 1, 2}, torch::kInt64).reshape({4, 3});
  return table.index_select(0, largest);
}

}  // namespace

SmallestThree smallest_three(const torch::Tensor& quaternions) {
  const torch::Tensor norm = quaternions.norm(2, 1, true);
  const torch::Tensor first = torch::zeros_like(quaternions).index_fill_(1, torch::tensor({0}), 1);
  torch::Tensor unit = torch::where(norm > 0, quaternions / norm, first);
  const torch::Tensor largest = unit.abs().argmax(1);
  unit = torch::where(unit.gather(1, largest.unsqueeze(1)) < 0, -unit, unit);
  return {largest, unit.gather(1, remaining(largest))};
}

torch::Tensor joined(const SmallestThree& parts) {
  const torch::Tensor most = (1 - parts.others.square().sum(1, true)).clamp_min(0).sqrt();
  torch::Tensor out = torch::empty({parts.others.size(0), 4}, parts.others.options());
  out.scatter_(1, remaining(parts.largest), parts.others);
  return out.scatter_(1, parts.largest.unsqueeze(1), most);
}

torch::Tensor packed_32(const torch::Tensor& largest, const torch::Tensor& fields) {
  return ((largest * 1024 + fields.select(1, 0)) * 1024 + fields.select(1, 1)) * 1024 +
         fields.select(1, 2);
}

torch::Tensor fields_of(const torch::Tensor& packed) {
  const auto field = [&](int64_t shift) {
    return packed.bitwise_right_shift(shift).bitwise_and(1023);
  };
  return torch::stack({field(20), field(10), field(0)}, 1);
}

}  // namespace jade::gaussians
