// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/gaussian_model.h"

#include <algorithm>

#include "jade/core/check.h"

namespace jade::gaussians {
namespace {

constexpr int64_t kCoefficients = 16;

torch::Tensor leaf(const torch::Tensor& value) {
  return value.detach().contiguous().set_requires_grad(true);
}

torch::Tensor widened(const torch::Tensor& sh) {
  const int64_t missing = kCoefficients - sh.size(1);
  return missing == 0 ? sh : torch::cat({sh, sh.new_zeros({sh.size(0), missing, 3})}, 1);
}

}  // namespace

torch::Tensor& parameter(splat::Gaussians& gaussians, int index) {
  torch::Tensor* const list[kParameterCount] = {&gaussians.means, &gaussians.rotations,
                                                &gaussians.log_scales, &gaussians.logit_opacities,
                                                &gaussians.sh};
  return *list[index];
}

const torch::Tensor& parameter(const splat::Gaussians& gaussians, int index) {
  return parameter(const_cast<splat::Gaussians&>(gaussians), index);
}

splat::Gaussians map_parameters(const splat::Gaussians& gaussians,
                                const std::function<torch::Tensor(const torch::Tensor&)>& map) {
  splat::Gaussians result;
  for (int i = 0; i < kParameterCount; ++i) parameter(result, i) = map(parameter(gaussians, i));
  return result;
}

GaussianModel::GaussianModel(const splat::Gaussians& start, double extent, torch::Device device)
    : extent_(extent) {
  JADE_CHECK(extent > 0 && std::isfinite(extent),
             "GaussianModel: expected a positive extent, found ", extent);
  splat::check(start);
  splat::Gaussians wide =
      map_parameters(start, [](const torch::Tensor& value) { return value.detach(); });
  wide.sh = widened(wide.sh);
  replace(map_parameters(wide, [&](const torch::Tensor& value) {
    return value.to(device, torch::kFloat32, /*non_blocking=*/false, /*copy=*/true);
  }));
}

splat::Gaussians GaussianModel::gradients() const {
  return map_parameters(parameters_, [](const torch::Tensor& value) { return value.grad(); });
}

splat::Gaussians GaussianModel::detached() const {
  return map_parameters(parameters_, [](const torch::Tensor& value) { return value.detach(); });
}

void GaussianModel::replace(splat::Gaussians values) {
  splat::check(values);
  check_shape(values.sh, "sh", {-1, kCoefficients, 3});
  parameters_ = map_parameters(values, leaf);
}

int active_sh_degree(int64_t step, int64_t every) {
  return static_cast<int>(std::min<int64_t>(3, step / every));
}

}  // namespace jade::gaussians
