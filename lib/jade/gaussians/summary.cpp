// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/summary.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/gaussians/gaussian_model.h"

namespace jade::gaussians {
namespace {

int64_t count_of(const torch::Tensor& mask) { return mask.sum().item<int64_t>(); }

/// [N], whether a row is all numbers.
torch::Tensor finite_rows(const torch::Tensor& tensor) {
  return tensor.reshape({tensor.size(0), -1}).isfinite().all(1);
}

/// [N], whether all numbers of a Gaussian are finite.
torch::Tensor is_drawable(const splat::Gaussians& gaussians) {
  torch::Tensor drawn = finite_rows(gaussians.means);
  for (const torch::Tensor* tensor :
       {&gaussians.rotations, &gaussians.log_scales, &gaussians.logit_opacities, &gaussians.sh}) {
    drawn = drawn.logical_and(finite_rows(*tensor));
  }
  return drawn;
}

void find_problems(const splat::Gaussians& g, GaussianSummary& summary) {
  const auto add = [&](const auto&... parts) { summary.problems.push_back(concat(parts...)); };
  if (summary.count == 0) {
    add("holds no Gaussian: training pruned everything, or the file was cut; lower "
        "densify.prune_opacity or check the poses");
    return;
  }
  const std::pair<const char*, torch::Tensor> parts[] = {{"means", g.means},
                                                         {"rotations", g.rotations},
                                                         {"log scales", g.log_scales},
                                                         {"opacity logits", g.logit_opacities},
                                                         {"colours", g.sh}};
  for (const auto& [name, tensor] : parts) {
    const int64_t bad = count_of(finite_rows(tensor).logical_not());
    if (bad > 0) {
      add(bad, " of ", summary.count, " Gaussians have NaN or Inf in their ", name,
          ": they cannot be drawn; export from an older checkpoint, or delete them");
    }
  }
  const int64_t unturned = count_of(g.rotations.square().sum(1) < 1e-12);
  if (unturned > 0) add(unturned, " rotations are the zero quaternion: set them to 1 0 0 0");
  if (summary.transparent > 0.5) {
    add("more than half of the Gaussians are next to transparent (opacity below ", kTransparent,
        "): saved just after an opacity reset? train on, or use a later checkpoint");
  }
  const double extent = std::max({summary.x.high - summary.x.low, summary.y.high - summary.y.low,
                                  summary.z.high - summary.z.low});
  if (extent > 0 && summary.scale.high > extent) {
    add("more than 1 % of the Gaussians are larger than the whole scene (", summary.scale.high,
        " of ", extent,
        " units): a fog of them; check the poses, or lower "
        "densify.prune_scale");
  }
  const double reach =
      std::max({std::abs(summary.x.min), std::abs(summary.x.max), std::abs(summary.y.min),
                std::abs(summary.y.max), std::abs(summary.z.min), std::abs(summary.z.max)});
  if (extent > 0 && reach > 1000 * extent) {
    add("some Gaussians lie ", reach,
        " units away, a thousand times the scene's size: floaters; "
        "viewers may frame them instead of the scene, delete them");
  }
}

}  // namespace

Spread spread_of(const torch::Tensor& values) {
  const torch::Tensor flat = values.flatten();
  const torch::Tensor sorted =
      std::get<0>(flat.masked_select(flat.isfinite()).to(torch::kFloat64).sort());
  const int64_t count = sorted.numel();
  if (count == 0) return {};
  const auto at = [&](double share) {
    return sorted[static_cast<int64_t>(std::lround(share * double(count - 1)))].item<double>();
  };
  return {at(0), at(0.01), at(0.5), at(0.99), at(1)};
}

GaussianSummary summarize(const splat::Gaussians& g) {
  GaussianSummary summary;
  summary.count = g.means.size(0);
  summary.sh_degree = std::lround(std::sqrt(double(g.sh.size(1)))) - 1;
  if (summary.count > 0) {
    summary.x = spread_of(g.means.select(1, 0));
    summary.y = spread_of(g.means.select(1, 1));
    summary.z = spread_of(g.means.select(1, 2));
    const torch::Tensor opacity = g.logit_opacities.sigmoid();
    summary.opacity = spread_of(opacity);
    summary.transparent = double(count_of(opacity < kTransparent)) / double(summary.count);
    const torch::Tensor longest = g.log_scales.amax(1);
    summary.scale = spread_of(longest.exp());
    summary.elongation = spread_of((longest - g.log_scales.amin(1)).exp());
  }
  find_problems(g, summary);
  return summary;
}

splat::Gaussians drawable(const splat::Gaussians& gaussians) {
  if (gaussians.size() == 0) return gaussians;
  const torch::Tensor drawn = is_drawable(gaussians);
  if (drawn.all().item<bool>()) return gaussians;
  return map_parameters(gaussians,
                        [&](const torch::Tensor& value) { return value.index({drawn}); });
}

std::string undrawable_warning(const splat::Gaussians& gaussians, const std::string& file) {
  if (gaussians.size() == 0) return {};
  const int64_t left = gaussians.size() - count_of(is_drawable(gaussians));
  if (left == 0) return {};
  return concat(
      file, ": ", left, " of ", gaussians.size(),
      " Gaussians have NaN or Inf in their numbers and are not drawn; jade_inspect says in "
      "which");
}

}  // namespace jade::gaussians
