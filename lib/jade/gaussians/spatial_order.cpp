// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/spatial_order.h"

#include <tuple>

namespace jade::gaussians {
namespace {

constexpr int64_t kBits = 20;  ///< per axis: three fit into an int64

/// The low 20 bits with two zeros after each.
torch::Tensor spread_bits(torch::Tensor bits) {
  for (const auto& [shift, mask] : {std::pair<int64_t, int64_t>{32, 0x1f00000000ffff},
                                    {16, 0x1f0000ff0000ff},
                                    {8, 0x100f00f00f00f00f},
                                    {4, 0x10c30c30c30c30c3},
                                    {2, 0x1249249249249249}}) {
    bits = bits.bitwise_or(bits.bitwise_left_shift(shift)).bitwise_and(mask);
  }
  return bits;
}

}  // namespace

torch::Tensor spatial_order(const torch::Tensor& points) {
  if (points.size(0) == 0) return torch::empty({0}, torch::kInt64);
  const torch::Tensor places = points.detach().to(torch::kCPU, torch::kFloat64);
  const torch::Tensor low = std::get<0>(places.min(0)), high = std::get<0>(places.max(0));
  const double most = double((int64_t(1) << kBits) - 1);
  const torch::Tensor cells =
      ((places - low) / (high - low).clamp_min(1e-30) * most).round().to(torch::kInt64);
  torch::Tensor code = torch::zeros({points.size(0)}, torch::kInt64);
  for (int64_t axis = 0; axis < 3; ++axis) {
    code = code.bitwise_or(spread_bits(cells.select(1, axis)).bitwise_left_shift(axis));
  }
  return code.argsort(/*stable=*/true, 0, false);
}

}  // namespace jade::gaussians
