// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/axes.h"

#include <cmath>

#include "jade/geometry/pose.h"
#include "jade/splat/math/sh.h"

namespace jade::gaussians {
namespace {

/// Signs of the SH coefficients beyond the first when y and z change sign.
const std::vector<float> kShSigns = {-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1};

/// Directions, uniform on the sphere, that overdetermine 16 SH coefficients.
constexpr int64_t kDirections = 64;

/// [M,3] float64, a Fibonacci sphere.
torch::Tensor directions() {
  const torch::Tensor i = torch::arange(kDirections, torch::kFloat64);
  const torch::Tensor z = 1 - (2 * i + 1) / double(kDirections);
  const torch::Tensor angle = i * (M_PI * (3 - std::sqrt(5.0)));
  const torch::Tensor radius = (1 - z.square()).sqrt();
  return torch::stack({radius * angle.cos(), radius * angle.sin(), z}, 1).contiguous();
}

/// [M,K]: the SH basis at directions [M,3].
torch::Tensor basis_at(const torch::Tensor& at, int64_t count) {
  const torch::Tensor rows = at.contiguous();
  torch::Tensor basis = torch::empty({rows.size(0), 16}, torch::kFloat64);
  const int degree = static_cast<int>(std::lround(std::sqrt(double(count)))) - 1;
  for (int64_t i = 0; i < rows.size(0); ++i) {
    splat::math::sh_basis(degree, rows.data_ptr<double>() + 3 * i,
                          basis.data_ptr<double>() + 16 * i);
  }
  return basis.slice(1, 0, count);
}

/// Coefficients [N,K,3] whose colour at R d is that of `sh` at d. Computes the matrix between them
/// by least squares over more directions than there are coefficients.
torch::Tensor rotated_sh(const torch::Tensor& sh, const torch::Tensor& rotation) {
  if (sh.size(1) == 1) return sh;
  const torch::Tensor at = directions();
  const torch::Tensor from = basis_at(at.mm(rotation), sh.size(1));
  const torch::Tensor matrix = torch::linalg_pinv(basis_at(at, sh.size(1))).mm(from);
  return torch::matmul(matrix.to(sh.scalar_type()), sh);
}

/// q ⊗ rows of `others`, wxyz.
torch::Tensor product(const geometry::Quaternion& a, const torch::Tensor& others) {
  const torch::Tensor left = torch::tensor({a[0], -a[1], -a[2], -a[3], a[1], a[0], -a[3], a[2],
                                            a[2], a[3], a[0], -a[1], a[3], -a[2], a[1], a[0]},
                                           torch::kFloat64)
                                 .reshape({4, 4})
                                 .to(others.scalar_type());
  return others.mm(left.t());
}

geometry::Quaternion quaternion_from(const torch::Tensor& rotation) {
  const auto r = rotation.accessor<double, 2>();
  geometry::Matrix3 matrix{};
  for (int64_t i = 0; i < 3; ++i) {
    for (int64_t j = 0; j < 3; ++j) matrix[static_cast<size_t>(3 * i + j)] = r[i][j];
  }
  return geometry::quaternion_from_rotation(matrix);
}

}  // namespace

splat::Gaussians half_turn(const splat::Gaussians& gaussians) {
  const auto options = gaussians.means.options();
  splat::Gaussians out = gaussians;
  out.means = gaussians.means * torch::tensor({1, -1, -1}, options);
  out.rotations = gaussians.rotations * torch::tensor({1, 1, -1, -1}, options);
  const int64_t rest = gaussians.sh.size(1) - 1;
  const torch::Tensor signs =
      torch::cat({torch::ones({1}), torch::tensor(kShSigns).slice(0, 0, rest)}).to(options);
  out.sh = gaussians.sh * signs.view({1, rest + 1, 1});
  return out;
}

splat::Gaussians moved(const splat::Gaussians& gaussians, const torch::Tensor& rotation,
                       double scale, const torch::Tensor& shift) {
  splat::Gaussians out = gaussians;
  const torch::Tensor means = gaussians.means.to(torch::kFloat64);
  out.means = (scale * means.mm(rotation.t()) + shift).to(gaussians.means.scalar_type());
  out.rotations = product(quaternion_from(rotation), gaussians.rotations);
  out.log_scales = gaussians.log_scales + std::log(scale);
  out.sh = rotated_sh(gaussians.sh, rotation);
  return out;
}

}  // namespace jade::gaussians
