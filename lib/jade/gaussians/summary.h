// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// Smallest, largest and quantiles of finite values.
struct Spread {
  double min = 0, low = 0, median = 0, high = 0, max = 0;  ///< low and high: 1 % and 99 %
};

/// @param values  of any shape; all zero where none is finite.
Spread spread_of(const torch::Tensor& values);

/// Opacity below which a Gaussian is next to transparent; training prunes such.
inline constexpr double kTransparent = 0.005;

/// Statistics of Gaussians, and their problems.
struct GaussianSummary {
  int64_t count = 0;
  int64_t sh_degree = 0;
  Spread x, y, z;                     ///< of the means
  Spread opacity;                     ///< after the sigmoid
  Spread scale;                       ///< longest axis, world units
  Spread elongation;                  ///< longest over shortest axis
  double transparent = 0;             ///< share with an opacity below kTransparent
  std::vector<std::string> problems;  ///< one line each, with the fix
};

GaussianSummary summarize(const splat::Gaussians& gaussians);

/// Gaussians whose numbers are finite and within the limits of splat/math/projection.h; splatting
/// renders no others.
splat::Gaussians drawable(const splat::Gaussians& gaussians);

/// A warning in one line for who only renders them: how many Gaussians of `file` are left out of
/// every picture, as some of their numbers are not finite or too large, or that all are
/// transparent. Empty where there is nothing to say.
std::string undrawable_warning(const splat::Gaussians& gaussians, const std::string& file);

/// How many Gaussians each reason keeps from being rendered, "3 have NaN or Inf in their means, …".
std::string undrawable_reasons(const splat::Gaussians& gaussians);

/// Number of Gaussians with an opacity of at least 1/255, below which splatting renders nothing.
int64_t count_visible(const splat::Gaussians& gaussians);

}  // namespace jade::gaussians
