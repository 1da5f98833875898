// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace jade::test {

/// log: SE(3) → se(3), the inverse of geometry::se3_exp for rotations by less than 90°, in terms of
/// s = sin θ · axis, the antisymmetric part of the rotation.
/// @param motion  [...,4,4] float64, rigid
/// @return [...,6]; differentiable
inline torch::Tensor se3_log(const torch::Tensor& motion) {
  const torch::Tensor rotation = motion.narrow(-2, 0, 3).narrow(-1, 0, 3);
  const torch::Tensor skew = (rotation - rotation.transpose(-1, -2)) / 2;
  const auto at = [&](int64_t row, int64_t column) {
    return skew.select(-2, row).select(-1, column);
  };
  const torch::Tensor sine = torch::stack({at(2, 1), at(0, 2), at(1, 0)}, -1);
  // Series near 0, where the closed forms cancel and have no derivative.
  const auto ratio = [](const torch::Tensor& x, const std::vector<double>& series,
                        const auto& closed) {
    const torch::Tensor small = x < 1e-2;
    const torch::Tensor near = torch::where(small, x, torch::zeros_like(x));
    torch::Tensor sum = torch::zeros_like(x);
    for (size_t i = series.size(); i-- > 0;) sum = sum * near + series[i];
    return torch::where(small, sum, closed(torch::where(small, torch::ones_like(x) / 2, x)));
  };
  const torch::Tensor square = sine.square().sum(-1);
  // θ / sin θ
  const torch::Tensor omega =
      sine * ratio(square,
                   {1, 1. / 6, 3. / 40, 15. / 336, 105. / 3456, 945. / 42240, 10395. / 599040},
                   [](const torch::Tensor& x) { return x.sqrt().asin() / x.sqrt(); })
                 .unsqueeze(-1);
  // (I + B[ω] + C[ω]²)⁻¹ t = t − ω × t / 2 + D ω × (ω × t)
  const torch::Tensor d =
      ratio(omega.square().sum(-1),
            {1. / 12, 1. / 720, 1. / 30240, 1. / 1209600, 1. / 47900160, 691. / 1307674368000},
            [](const torch::Tensor& x) {
              const torch::Tensor angle = x.sqrt();
              return (1 - angle * angle.sin() / (2 * (1 - angle.cos()))) / x;
            });
  const torch::Tensor shift = motion.narrow(-2, 0, 3).select(-1, 3);
  const torch::Tensor turned = torch::linalg_cross(omega, shift, -1);
  const torch::Tensor along =
      shift - turned / 2 + d.unsqueeze(-1) * torch::linalg_cross(omega, turned, -1);
  return torch::cat({along, omega}, -1);
}

}  // namespace jade::test
