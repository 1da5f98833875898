// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/geometry/pose.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// Smallest, largest and quantiles of finite values.
struct Spread {
  double min = 0, low = 0, median = 0, high = 0, max = 0;  ///< low and high: 1 % and 99 %
};

/// @param values  of any shape; all statistics are zero if no value is finite.
Spread spread_of(const torch::Tensor& values);

/// Opacity below which a Gaussian is nearly transparent; training prunes such Gaussians.
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

/// Centre and radius of the bulk of a scene, without strays.
struct Bulk {
  geometry::Vector3 middle;
  double radius;  ///< above 0
};

Bulk bulk_of(const splat::Gaussians& gaussians);

/// Near plane for a scene whose cameras are unknown: `usual`, or 1 % of the radius of a scene so
/// small that its cameras can be nearer than that.
double near_plane_of(const splat::Gaussians& gaussians, double usual);

/// Gaussians whose numbers are finite and within the limits of splat/math/projection.h; only these
/// can be rendered.
splat::Gaussians drawable(const splat::Gaussians& gaussians);

/// A one-line warning before rendering: how many Gaussians of `file` are in no picture, because
/// some of their numbers are not finite or too large, or that all are transparent. Empty if there
/// is nothing to report.
std::string undrawable_warning(const splat::Gaussians& gaussians, const std::string& file);

/// The number of Gaussians that each reason excludes from rendering, "3 have NaN or Inf in their
/// means, …".
std::string undrawable_reasons(const splat::Gaussians& gaussians);

/// Number of Gaussians with an opacity of at least 1/255; fainter ones are not rendered.
int64_t count_visible(const splat::Gaussians& gaussians);

}  // namespace jade::gaussians
