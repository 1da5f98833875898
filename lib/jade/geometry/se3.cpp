// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/se3.h"

#include "jade/core/check.h"

namespace jade::geometry {
namespace {

/// Below this θ² the closed forms suffer from cancellation and the series are exact to 1e-16.
constexpr double kSmall = 1e-2;

/// `closed(x)` if x is large, else the polynomial Σ c_i x^i. Gradients flow through the chosen
/// branch only, so the closed form is never evaluated near its singularity.
template <class F>
torch::Tensor closed_or_series(const torch::Tensor& x, const std::vector<double>& coefficients,
                               const F& closed) {
  const torch::Tensor small = x < kSmall;
  const torch::Tensor near = torch::where(small, x, torch::zeros_like(x));
  torch::Tensor series = torch::full_like(x, coefficients.back());
  for (size_t i = coefficients.size() - 1; i-- > 0;) series = series * near + coefficients[i];
  return torch::where(small, series, closed(torch::where(small, torch::ones_like(x), x)));
}

torch::Tensor sine_ratio(const torch::Tensor& square) {  // A
  return closed_or_series(square, {1, -1. / 6, 1. / 120, -1. / 5040, 1. / 362880, -1. / 39916800},
                          [](const torch::Tensor& x) { return x.sqrt().sin() / x.sqrt(); });
}

torch::Tensor versine(const torch::Tensor& square) {  // B
  return closed_or_series(square,
                          {1. / 2, -1. / 24, 1. / 720, -1. / 40320, 1. / 3628800, -1. / 479001600},
                          [](const torch::Tensor& x) { return (1 - x.sqrt().cos()) / x; });
}

torch::Tensor cubic(const torch::Tensor& square) {  // C
  return closed_or_series(
      square, {1. / 6, -1. / 120, 1. / 5040, -1. / 362880, 1. / 39916800, -1. / 6227020800},
      [](const torch::Tensor& x) { return (x.sqrt() - x.sqrt().sin()) / (x * x.sqrt()); });
}

/// [ω], [...,3] → [...,3,3].
torch::Tensor cross_matrix(const torch::Tensor& omega) {
  const auto w = omega.unbind(-1);
  const torch::Tensor zero = torch::zeros_like(w[0]);
  return torch::stack({torch::stack({zero, -w[2], w[1]}, -1), torch::stack({w[2], zero, -w[0]}, -1),
                       torch::stack({-w[1], w[0], zero}, -1)},
                      -2);
}

torch::Tensor rigid(const torch::Tensor& rotation, const torch::Tensor& translation) {
  const torch::Tensor top = torch::cat({rotation, translation.unsqueeze(-1)}, -1);
  std::vector<int64_t> shape = top.sizes().vec();
  shape[shape.size() - 2] = 1;
  const torch::Tensor last = torch::tensor({0, 0, 0, 1}, top.options().requires_grad(false));
  return torch::cat({top, last.expand(shape)}, -2);
}

torch::Tensor apply(const torch::Tensor& matrix, const torch::Tensor& vector) {
  return matrix.matmul(vector.unsqueeze(-1)).squeeze(-1);
}

torch::Tensor scalar_to_matrix(const torch::Tensor& scalar) {
  return scalar.unsqueeze(-1).unsqueeze(-1);
}

torch::Tensor rotation_part(const torch::Tensor& motion) {
  return motion.narrow(-2, 0, 3).narrow(-1, 0, 3);
}

torch::Tensor translation_part(const torch::Tensor& motion) {
  return motion.narrow(-2, 0, 3).select(-1, 3);
}

}  // namespace

torch::Tensor se3_exp(const torch::Tensor& twist) {
  JADE_CHECK(twist.dim() >= 1 && twist.size(-1) == 6, "twist: expected [...,6], found ",
             shape_string(twist));
  const torch::Tensor rho = twist.narrow(-1, 0, 3), omega = twist.narrow(-1, 3, 3);
  const torch::Tensor square = omega.square().sum(-1);
  const torch::Tensor first = cross_matrix(omega), second = first.matmul(first);
  const torch::Tensor identity = torch::eye(3, twist.options().requires_grad(false));
  const torch::Tensor rotation = identity + scalar_to_matrix(sine_ratio(square)) * first +
                                 scalar_to_matrix(versine(square)) * second;
  const torch::Tensor along = identity + scalar_to_matrix(versine(square)) * first +
                              scalar_to_matrix(cubic(square)) * second;
  return rigid(rotation, apply(along, rho));
}

torch::Tensor twist_unit(double unit) {
  return torch::tensor({unit, unit, unit, 1., 1., 1.}, torch::kFloat64);
}

torch::Tensor se3_inverse(const torch::Tensor& motion) {
  const torch::Tensor back = rotation_part(motion).transpose(-1, -2);
  return rigid(back, -apply(back, translation_part(motion)));
}

}  // namespace jade::geometry
