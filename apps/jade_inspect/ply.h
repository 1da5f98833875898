// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/splat/gaussians.h"

namespace jade::apps {

/// Smallest, largest and quantiles of finite values.
struct Spread {
  double min = 0, low = 0, median = 0, high = 0, max = 0;  ///< low and high: 1 % and 99 %
};

/// What jade_inspect says of Gaussians.
struct GaussianSummary {
  int64_t count = 0;
  int64_t sh_degree = 0;
  bool antialiased = false;
  Spread x, y, z;                     ///< of the means
  Spread opacity;                     ///< after the sigmoid
  Spread scale;                       ///< longest axis, world units
  Spread elongation;                  ///< longest over shortest axis
  double transparent = 0;             ///< share with an opacity below 0.005, which training prunes
  std::vector<std::string> problems;  ///< one line each, with the fix
};

GaussianSummary summarize(const splat::Gaussians& gaussians);

/// A .ply of Gaussians, or of plain points, as text or JSON on stdout.
/// @throws DataError naming the path.
void inspect_ply(const std::filesystem::path& path, bool json);

void print_text(const GaussianSummary& summary);
nlohmann::json to_json(const GaussianSummary& summary);

}  // namespace jade::apps
