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

/// Gaussians whose numbers are all finite; splatting renders no others.
splat::Gaussians drawable(const splat::Gaussians& gaussians);

/// A warning in one line for who only draws them: how many Gaussians of `file` are left out of
/// every picture, as some of their numbers are not finite. Empty where there is none.
std::string undrawable_warning(const splat::Gaussians& gaussians, const std::string& file);

}  // namespace jade::gaussians
