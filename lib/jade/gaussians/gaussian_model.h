// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <string>
#include <torch/types.h>

#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// The tensors of a Gaussians in a fixed order, for code that treats them uniformly.
inline constexpr int kParameterCount = 5;
inline constexpr std::array<const char*, kParameterCount> kParameterNames = {
    "means", "rotations", "log_scales", "logit_opacities", "sh"};
torch::Tensor& parameter(splat::Gaussians& gaussians, int index);
const torch::Tensor& parameter(const splat::Gaussians& gaussians, int index);

/// Applies `map` to every tensor.
splat::Gaussians map_parameters(const splat::Gaussians& gaussians,
                                const std::function<torch::Tensor(const torch::Tensor&)>& map);

/// The scene φ: N Gaussians as leaf tensors that require gradients. Parameters are stored raw (log
/// scales, logit opacities, unnormalised quaternions); splat::render activates them. SH is one
/// tensor [N,16,3] whatever degree is active.
class GaussianModel {
 public:
  GaussianModel() = default;

  /// Copies the tensors to `device`, and pads SH of a lower degree with zeros to 16 coefficients.
  /// @param extent  size of the scene in world units (see scene_extent), positive.
  /// @throws ContractError for shapes that do not match or an extent that is not positive.
  GaussianModel(const splat::Gaussians& start, double extent, torch::Device device);

  const splat::Gaussians& parameters() const { return parameters_; }
  int64_t size() const { return parameters_.size(); }
  double extent() const { return extent_; }
  torch::Device device() const { return parameters_.means.device(); }

  /// Gradients of the last backward pass; undefined tensors if there are none.
  splat::Gaussians gradients() const;

  /// Returns the parameters themselves without gradient, for rendering, saving and tests.
  splat::Gaussians detached() const;

  /// Replaces the parameters by new leaves that own these tensors, without gradients; the caller
  /// must not change them afterwards. Only densification may call it, because the optimiser's rows
  /// must change with them.
  /// @throws ContractError for shapes that do not match.
  void replace(splat::Gaussians values);

 private:
  splat::Gaussians parameters_;
  double extent_ = 1;
};

/// The active SH degree at `step` (counted from 1): starts at 0 and increases by one every `every`
/// steps, up to 3.
int active_sh_degree(int64_t step, int64_t every = 1000);

}  // namespace jade::gaussians
